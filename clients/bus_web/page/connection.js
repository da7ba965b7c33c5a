// The WebSocket to the server: opened again and again once it has gone, until the page is closed.

const AGAIN_MS = 1000;
const REFUSED = 1008; // the code with which the server closes a connection that it does not want, with a reason

export class Connection {
  // `heard` is called with each object; `changed` with "open", "closed", "refused" and the reason, or "shut": the token is
  // of an earlier start.
  constructor(heard, changed) {
    this.heard = heard;
    this.changed = changed;
    this.socket = null;
    this.open();
  }

  open() {
    const socket = new WebSocket(`ws://${location.host}/`, "busd.page.v1");
    this.socket = socket;
    let wasOpen = false;
    socket.onopen = () => { wasOpen = true; this.changed("open"); };
    socket.onmessage = (event) => this.heard(JSON.parse(event.data));
    socket.onclose = async ({ code, reason }) => {
      this.socket = null;
      if (code === REFUSED && reason) this.changed("refused", reason);
      else this.changed(wasOpen || await this.mayCome() ? "closed" : "shut");
      setTimeout(() => this.open(), AGAIN_MS);
    };
  }

  // A browser does not tell why a WebSocket was refused before it was open.
  async mayCome() {
    try {
      return (await fetch("/icon.svg")).status !== 403;
    } catch {
      return true;
    }
  }

  say(op, fields) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ op, ...fields }));
  }
}
