// The line to the session in Python: orders, their answers by number, and what it tells by itself. Offline: a replay.
const byId = id => document.getElementById(id);
const dress = name => getComputedStyle(document.documentElement).getPropertyValue(name);  // a colour of the page's style
const hearers = {}, waiting = new Map();
const link = { socket: null, number: 0, offline: replay !== null };
const on = (kind, hearer) => { hearers[kind] = hearer; };

function heard(message) {
  hearers[message.kind]?.(message);
  waiting.get(message.id)?.(message);
  waiting.delete(message.id);
}

function ask(message) {                  // resolves to the order's own answer; orders answered later by a job resolve never
  const id = ++link.number;
  if (link.socket?.readyState !== WebSocket.OPEN) return new Promise(() => {});
  link.socket.send(JSON.stringify({ ...message, id }));
  return new Promise(done => waiting.set(id, done));
}

function latest() {                      // one order under way; of those that come meanwhile the last
  let busy = false, next = null;
  const pump = async () => {
    if (busy || !next) return;
    const { message, done } = next;
    [busy, next] = [true, null];
    done(await ask(message));
    busy = false;
    pump();
  };
  return message => new Promise(done => { next = { message, done }; pump(); });
}

function later(wait, work) {             // once nothing has asked for it for a while
  let timer = 0;
  return () => { clearTimeout(timer); timer = setTimeout(work, wait); };
}

function connect(opened) {
  link.socket = new WebSocket(`ws://${location.host}${location.pathname}session`);
  link.socket.onmessage = event => heard(JSON.parse(event.data));
  link.socket.onopen = opened;
  link.socket.onclose = () => {
    document.querySelectorAll(".side input, .side button").forEach(one => { one.disabled = true; });
    say("The studio has ended; start it again and reload this page.", true);
  };
}

function say(words, bad = false) {
  byId("said").textContent = words;
  byId("said").classList.toggle("bad", bad);
}

const bytes = text => Uint8Array.from(atob(text), character => character.charCodeAt(0));
