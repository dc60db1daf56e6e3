// The link to the server: one WebSocket that connects again by itself, and the few requests of SITUATION.md.

const STALE = 2000; // ms without a message
const OLD = 3000; // ms with messages that bring no newer state of own ship
const AGAIN = [500, 1000, 2000, 4000]; // ms to wait before the next attempt
const TOKEN = new URLSearchParams(location.search).get("token");

export class Link {
  // `onMessage(situation)` for the newest message of each frame that the browser draws: what comes faster is not drawn.
  // `onState("live" | "old" | "stale" | "lost", ms since what is shown was new, or null)` twice a second and with each message.
  constructor(onMessage, onState) {
    this.onMessage = onMessage;
    this.onState = onState;
    this.heard = null; // when the last message came
    this.moved = null; // when own ship's state was last a newer one
    this.time = null; // of that state
    this.text = null; // the newest message, until it is drawn
    this.attempt = 0;
    this.open = false;
    this.connect();
    setInterval(() => this.tell(), 500);
  }

  connect() {
    const address = new URL("ws", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    address.search = TOKEN ? `?token=${encodeURIComponent(TOKEN)}` : "";
    const socket = new WebSocket(address);
    socket.onopen = () => {
      this.open = true;
      this.attempt = 0;
    };
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = () => {
      this.open = false;
      setTimeout(() => this.connect(), AGAIN[Math.min(this.attempt++, AGAIN.length - 1)]);
    };
  }

  take(text) {
    if (this.text === null) requestAnimationFrame(() => this.read());
    this.text = text;
    this.heard = performance.now();
  }

  read() {
    const text = this.text;
    this.text = null;
    const situation = JSON.parse(text);
    if (situation.time !== this.time || situation.time === null) this.moved = this.heard;
    this.time = situation.time;
    this.onMessage(situation);
    this.tell();
  }

  tell() {
    const now = performance.now();
    const age = this.heard === null ? null : now - this.heard;
    if (age === null || age >= STALE) return this.onState(this.open ? "stale" : "lost", age);
    if (this.moved !== null && now - this.moved >= OLD) return this.onState("old", now - this.moved);
    this.onState("live", age);
  }
}

// The answer as JSON; throws an Error with the server's one line.
export async function ask(address, body = null) {
  const headers = TOKEN ? { Authorization: `Bearer ${TOKEN}` } : {};
  const options = { headers };
  if (body !== null) {
    options.method = "POST";
    options.body = JSON.stringify(body);
    headers["Content-Type"] = "application/json";
  }
  const answer = await fetch(address, options);
  const data = await answer.json().catch(() => null);
  if (!answer.ok) throw new Error(data?.error ?? `${address}: the server answered ${answer.status}`);
  if (data === null) throw new Error(`${address}: the answer is no JSON`);
  return data;
}
