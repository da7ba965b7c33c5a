// The bus as the server has told of it last: nodes, topics, endpoints, and their rates.

export const SECONDS = 60;

export class Bus {
  constructor() {
    this.nodes = new Map();
    this.topics = new Map();
    this.ends = new Map();
    this.pairs = [];
    this.structure = 0; // one more with every other graph
  }

  setGraph(told) {
    this.structure += 1;
    this.nodes = new Map(told.nodes.map(([id, name, pid, isHidden, origin]) => [id, { id, name, pid, isHidden, origin }]));
    const topics = new Map();
    for (const [name, types, isHidden] of told.topics) {
      const before = this.topics.get(name);
      topics.set(name, Object.assign(before ?? newTopic(name), { types, isHidden, cut: 0, publishers: [], subscriptions: [] }));
    }
    const ends = new Map();
    for (const [id, kind, node, topic, type, qos, depth] of told.ends) {
      const end = {
        hz: null, queued: 0, lost: 0, lostPerS: 0, age: null, messages: null, bytes: null, dropped: {}, ...this.ends.get(id),
        id, kind, node, topic, type, qos, depth, routes: new Set(), reasons: [],
      };
      ends.set(id, end);
      topics.get(topic)[kind === "publisher" ? "publishers" : "subscriptions"].push(end);
    }
    this.topics = topics;
    this.ends = ends;
    this.pairs = told.pairs.map(([publisher, subscription, route, reason]) =>
      ({ publisher: ends.get(publisher), subscription: ends.get(subscription), route, reason }));
    for (const { publisher, subscription, route, reason } of this.pairs) {
      if (reason) topics.get(publisher.topic).cut += 1;
      for (const end of [publisher, subscription])
        if (route) end.routes.add(route);
        else end.reasons.push(reason);
    }
  }

  setHistory(told) {
    for (const [name, values] of Object.entries(told.topics)) {
      const topic = this.topics.get(name);
      if (topic) topic.history = values;
    }
  }

  setRates(told) {
    for (const [name, [hz, bytesPerS, queued, depth, lost, lostPerS, why, age]] of Object.entries(told.topics)) {
      const topic = this.topics.get(name);
      if (topic) Object.assign(topic, { hz, bytesPerS, queued, depth, lost, lostPerS, why, age });
    }
    for (const [id, [hz, queued, lost, lostPerS, age]] of Object.entries(told.ends)) {
      const end = this.ends.get(Number(id));
      if (end) Object.assign(end, { hz, queued, lost, lostPerS, age });
    }
    const now = Math.floor(performance.now() / 1000 + 0.25);
    for (const topic of this.topics.values()) topic.passed(now);
  }

  setDetail(told) {
    for (const [id, [messages, bytes, queued, dropped]] of Object.entries(told.ends)) {
      const end = this.ends.get(Number(id));
      if (end) Object.assign(end, { messages, bytes, queued, dropped });
    }
  }
}

function newTopic(name) {
  return {
    name, hz: null, bytesPerS: null, queued: 0, depth: null, lost: 0, lostPerS: 0, why: "", age: null, history: [], second: 0,
    passed(now) {
      if (now <= this.second) return;
      this.second = now;
      if (this.hz === null && !this.history.length) return; // what is not known yet is not nothing
      this.history.push(this.hz ?? 0);
      if (this.history.length > SECONDS) this.history.shift();
    },
  };
}
