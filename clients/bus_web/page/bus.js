// The bus as the server has told of it last: nodes, topics, endpoints, and their rates.

export const SECONDS = 60;
const MOST_GONE = 200;

export class Bus {
  constructor() {
    this.nodes = new Map();
    this.topics = new Map();
    this.ends = new Map();
    this.pairs = [];
    this.gone = new Map(); // topics that have left, with their past: after a restart of busd they come back
    this.structure = 0; // one more with every other graph
  }

  setGraph(told) {
    this.structure += 1;
    this.nodes = new Map(told.nodes.map(([id, name, pid, isHidden, origin]) => [id, { id, name, pid, isHidden, origin }]));
    const topics = new Map();
    for (const [name, types, isHidden] of told.topics) {
      const before = this.topics.get(name) ?? this.gone.get(name);
      this.gone.delete(name);
      topics.set(name, Object.assign(before ?? newTopic(name), { types, isHidden, cut: 0, publishers: [], subscriptions: [] }));
    }
    const ends = new Map();
    for (const [id, kind, node, topic, type, qos, depth] of told.ends) {
      const end = {
        hz: null, queued: 0, lost: 0, lostPerS: 0, age: null, messages: null, bytes: null, dropped: {}, lostHistory: [], advice: "", ...this.ends.get(id),
        id, kind, node, topic, type, qos, depth, routes: new Set(), reasons: [],
      };
      ends.set(id, end);
      topics.get(topic)[kind === "publisher" ? "publishers" : "subscriptions"].push(end);
    }
    for (const [name, topic] of this.topics) if (!topics.has(name) && topic.lostInAll) this.gone.set(name, topic);
    for (const name of this.gone.keys()) if (this.gone.size > MOST_GONE) this.gone.delete(name);
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
    for (const key of ["topics", "losses"])
      for (const [name, values] of Object.entries(told[key])) {
        const topic = this.topics.get(name);
        if (topic) topic[key === "topics" ? "history" : "lostHistory"] = values;
      }
  }

  setRates(told) {
    for (const [name, [hz, bytesPerS, queued, depth, lost, lostInAll, lostPerS, why, age]] of Object.entries(told.topics)) {
      const topic = this.topics.get(name);
      if (!topic) continue;
      topic.newlyLost += topic.lostInAll === null ? 0 : Math.max(0, lostInAll - topic.lostInAll);
      Object.assign(topic, { hz, bytesPerS, queued, depth, lost, lostInAll, lostPerS, why, age });
    }
    for (const [id, [hz, queued, lost, lostPerS, age]] of Object.entries(told.ends)) {
      const end = this.ends.get(Number(id));
      if (end) Object.assign(end, { hz, queued, lost, lostPerS, age });
    }
    const now = Math.floor(performance.now() / 1000 + 0.25);
    for (const topic of this.topics.values()) topic.passed(now);
  }

  setDetail(told) {
    for (const [id, [messages, bytes, queued, dropped, lostHistory, advice]] of Object.entries(told.ends)) {
      const end = this.ends.get(Number(id));
      if (end) Object.assign(end, { messages, bytes, queued, dropped, lostHistory, advice });
    }
    for (const topic of this.topics.values()) Object.assign(topic, { past: null, ages: null });
    for (const [name, ages] of Object.entries(told.ages)) {
      const topic = this.topics.get(name);
      if (topic) topic.ages = ages;
    }
    for (const [name, past] of Object.entries(told.losses)) {
      const topic = this.topics.get(name);
      if (topic) topic.past = past;
    }
  }
}

function newTopic(name) {
  return {
    name, hz: null, bytesPerS: null, queued: 0, depth: null, lost: 0, lostInAll: null, lostPerS: 0, why: "", age: null, history: [], second: 0,
    lostHistory: [], // messages lost in each second, as `history` has their rate
    newlyLost: 0, // in this second, so far
    past: null, // of a topic that is looked at: when messages were lost
    ages: null, // the same: parts of a histogram, each with its begin and end in ms, and the number of messages
    passed(now) {
      if (now <= this.second) return;
      const passed = this.second ? Math.min(now - this.second, SECONDS) : 1; // more than one: it was away, or the page slept
      this.second = now;
      const lost = this.newlyLost;
      this.newlyLost = 0;
      if (lost || this.lostHistory.length) {
        this.lostHistory.push(...Array(passed - 1).fill(0), lost);
        this.lostHistory = this.lostHistory.slice(-SECONDS);
        if (!this.lostHistory.some(Boolean)) this.lostHistory = [];
      }
      if (this.hz === null && !this.history.length) return; // what is not known yet is not nothing
      this.history.push(...Array(passed).fill(this.hz ?? 0));
      this.history = this.history.slice(-SECONDS);
    },
  };
}
