"use strict";
// A stream of frames: the scene, the curves, the states, and what is asked of the server.

const KEPT_S = 60, SPAN_S = 20;
const data = JSON.parse(document.getElementById("data").textContent);
const find = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") || "";
if (token) history.replaceState(null, "", location.pathname);

/** Rows that grow, in the form of a decoded flight; what is older than KEPT_S is forgotten. */
class Rows {
  constructor(columns) {
    this.columns = columns;
    this.clear();
  }

  clear() {
    this.count = 0;
    this.room = 4096;
    this.store = { t: new Float32Array(this.room) };
    for (const [name, width] of this.columns) this.store[name] = new Float32Array(this.room * width);
    this.show();
  }

  /** Views of what is there, so that lookups by time see no more. */
  show() {
    this.t = this.store.t.subarray(0, this.count);
    for (const [name, width] of this.columns) {
      this[name] = { width, data: this.store[name].subarray(0, this.count * width) };
    }
  }

  add(time, row) {
    if (this.count && time < this.t[this.count - 1]) return;
    if (this.count === this.room) this.forget(time - KEPT_S);
    this.store.t[this.count] = time;
    let at = 0;
    for (const [name, width] of this.columns) {
      for (let k = 0; k < width; k++) this.store[name][this.count * width + k] = row[at++] ?? NaN;
    }
    this.count++;
    this.show();
  }

  forget(before) {
    const first = Math.max(indexAt(this.t, before), this.room >> 1);
    this.store.t.copyWithin(0, first);
    for (const [name, width] of this.columns) this.store[name].copyWithin(0, first * width);
    this.count -= first;
  }
}

class Live {
  constructor() {
    this.curves = new Map();
    this.picked = [];
    this.now = 0;
    this.wire();
    this.connect();
    this.tick = this.tick.bind(this);
    requestAnimationFrame(this.tick);
    document.documentElement.dataset.ready = "yes";
  }

  connect() {
    const address = new URL("stream", location.href);
    address.protocol = address.protocol.replace("http", "ws");
    if (token) address.searchParams.set("token", token);
    this.socket = new WebSocket(address);
    this.socket.addEventListener("message", (event) => this.receive(JSON.parse(event.data)));
    this.socket.addEventListener("open", () => this.linked("connected", "good"));
    this.socket.addEventListener("close", () => {
      this.linked("no connection", "bad");
      setTimeout(() => this.connect(), 1000);
    });
  }

  linked(text, style) {
    find("link").textContent = text;
    find("link").className = `verdict ${style}`;
  }

  ask(what, value = null) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ do: what, value }));
  }

  receive(message) {
    const act = {
      hello: () => this.begin(message),
      frame: () => this.frame(message),
      picked: () => this.pickedNow(message.picked),
      playing: () => this.playing(message),
      answer: () => { find("answer").textContent = `${message.request}: ${message.message}`; },
      refused: () => { find("refused").textContent = message.message; },
    }[message.kind];
    if (act) act();
  }

  begin(hello) {
    this.rows = new Rows(hello.columns);
    this.curves.clear();
    this.marks = { ...data.milestones, obstacle: null, x_c_m: null, x_r_m: null, n_r: null };
    find("changes").replaceChildren();
    this.seekable = hello.seekable;
    this.contact = hello.contact_s;
    find("contact-key").hidden = this.contact === null;
    find("playback").hidden = !hello.seekable;
    find("operator").hidden = !hello.operable;
    if (hello.seekable) Object.assign(find("time"), { min: hello.first_s, max: hello.last_s });
    this.offer(hello.signals);
    hello.frames.forEach((frame) => this.frame(frame));
    if (hello.picked.length) this.pickedNow(hello.picked);
    else this.askFirst(hello.signals);
  }

  askFirst(signals) {
    this.ask("pick", data.first_picked.filter((name) => name in signals));
  }

  offer(signals) {
    find("signals").replaceChildren(...Object.keys(signals).map((name) => Object.assign(document.createElement("option"), { value: name })));
    this.units = signals;
  }

  frame(frame) {
    this.now = frame.t;
    this.rows.add(frame.t, frame.row);
    if (frame.signals) {
      this.offer(frame.signals);
      if (!this.picked.length) this.askFirst(frame.signals);
    }
    for (const [name, value] of Object.entries(frame.values)) {
      if (!this.curves.has(name)) this.curves.set(name, []);
      const curve = this.curves.get(name);
      curve.push([frame.t, value]);
      if (curve[0][0] < frame.t - 2 * KEPT_S) curve.splice(0, curve.length >> 1);
    }
    Object.assign(this.marks, frame.marks, { obstacle: frame.obstacle });
    for (const change of frame.changes) this.change(change);
    this.last = frame;
    if (frame.playing) this.playing(frame.playing);
  }

  change({ time_s, kind, of, text }) {
    const line = document.createElement("li"), time = document.createElement("time");
    line.className = kind.replace(/\W/g, "");
    time.textContent = `${time_s.toFixed(2)} s`;
    line.append(time, `${of}: ${text}`);
    find("changes").prepend(line);
    while (find("changes").children.length > 200) find("changes").lastChild.remove();
  }

  playing({ paused, speed }) {
    find("play").textContent = paused ? "▶" : "❚❚";
    find("play").setAttribute("aria-label", paused ? "Play" : "Pause");
    this.paused = paused;
    if (document.activeElement !== find("speed")) find("speed").value = String(speed);
  }

  // -- drawing ---------------------------------------------------------------------------

  tick() {
    requestAnimationFrame(this.tick);
    if (!this.rows || !this.rows.count || this.drawn === this.last && !this.scene?.camera.moving) return;
    this.drawn = this.last;
    if (!this.scene) this.makeScene();
    this.scene.flight = this.rows;
    this.scene.milestones = this.marks;
    if (!this.trailed || Math.abs(this.now - this.trailed) > 0.3) {
      this.scene.trail = this.scene.thinTrail();
      this.trailed = this.now;
    }
    this.scene.camera.glide(0.03);
    this.scene.draw(this.now);
    this.drawVehicles();
    this.write();
    this.drawCurves();
  }

  /** Rings and names of several vehicles; the first one is drawn whole. */
  drawVehicles() {
    for (const { name, position } of this.last.vehicles || []) {
      if (!position) continue;
      const ring = Array.from({ length: 25 }, (_, k) => {
        const angle = k * Math.PI / 12;
        return [position[0] + 0.4 * Math.cos(angle), position[1] + 0.4 * Math.sin(angle), position[2]];
      });
      this.scene.stroke(ring, this.scene.paint.blue, 2);
      this.scene.stroke([position, [position[0], position[1], 0]], this.scene.paint.muted, 1, [3, 3]);
      const [x, y, depth] = this.scene.see(position);
      if (depth > 0.1) this.scene.text(name, x, y - 10, this.scene.paint.ink, 12);
    }
  }

  makeScene() {
    this.scene = new Scene(find("scene"), this.rows, this.marks);
    this.scene.camera.places.action.reach = 2.4;
    this.scene.camera.following = true;
    this.scene.camera.look("action");
    this.scene.readColours();
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.scene.readColours());
  }

  write() {
    const { rows, last, now } = this;
    find("clock-time").textContent = `${now.toFixed(2)} s`;
    const phase = find("clock-phase");
    phase.textContent = last.state.phase || "";
    phase.style.background = data.milestones.phase_colours[Math.round(heldAt(rows, "mode", now)[0])] || "";
    fillList(find("gauges"), gaugeRows(rows, now));
    const { pose } = last, shown = (x) => (x === null ? "–" : `${x.toFixed(0)} ms`);
    const states = Object.entries(last.state).filter(([key]) => !key.startsWith("node "));
    const faulty = Object.entries(last.state).filter(([key, text]) => key.startsWith("node ") && !text.startsWith("ok"));
    const vehicles = (last.vehicles || []).map(({ name, position, phase }) =>
      [name, position ? `at ${position[2].toFixed(2)} m: ${phase || "no phase"}` : "not seen", position ? "" : "bad"]);
    fillList(find("states"), [
      ...vehicles,
      ["poses", `latency ${shown(pose.latency_ms)}, age ${shown(pose.age_ms)}`, pose.silent ? "bad" : ""],
      ...states,
      ...faulty.map(([key, text]) => [key, text, "bad"]),
    ]);
    if (this.seekable && document.activeElement !== find("time")) find("time").value = String(now);
  }

  drawCurves() {
    const colour = (name) => this.scene.colour(name), end = this.now, start = end - SPAN_S;
    for (const strip of find("strips").children) {
      const curve = (this.curves.get(strip.dataset.name) || []).filter(([t, v]) => t >= start && v !== null);
      const canvas = strip.querySelector("canvas"), sharp = window.devicePixelRatio || 1;
      const width = canvas.clientWidth, height = canvas.clientHeight, pen = canvas.getContext("2d");
      canvas.width = width * sharp;
      canvas.height = height * sharp;
      pen.setTransform(sharp, 0, 0, sharp, 0, 0);
      let low = Infinity, high = -Infinity;
      for (const [, v] of curve) { low = Math.min(low, v); high = Math.max(high, v); }
      const unit = this.units[strip.dataset.name] || "";
      strip.querySelector("output").textContent = curve.length ? `${curve.at(-1)[1].toPrecision(4)} ${unit}` : "–";
      if (!(low <= high)) continue;
      const bottom = height - 16;
      const { ticks, digits } = niceTicks(low - 1e-3, high + 1e-3 + (high - low) * 0.05, 3);
      const x = (t) => 44 + ((t - start) / SPAN_S) * (width - 50);
      const y = (v) => bottom - ((v - low) / Math.max(high - low, 1e-3)) * (bottom - 6);
      pen.font = "10px system-ui, sans-serif";
      pen.textAlign = "right";
      for (const tick of ticks) {
        pen.fillStyle = colour("muted");
        pen.fillText(tick.toFixed(digits), 40, y(tick) + 3);
        pen.strokeStyle = colour("line");
        pen.beginPath();
        pen.moveTo(44, y(tick));
        pen.lineTo(width, y(tick));
        pen.stroke();
      }
      pen.textAlign = "center";
      for (const tick of niceTicks(Math.max(start, 0), end, width / 80).ticks) {
        pen.fillText(`${tick.toFixed(0)} s`, x(tick), height - 3);
        pen.beginPath();
        pen.moveTo(x(tick), bottom);
        pen.lineTo(x(tick), bottom + 3);
        pen.stroke();
      }
      pen.strokeStyle = colour("blue");
      pen.lineWidth = 1.5;
      pen.beginPath();
      curve.forEach(([t, v], i) => (i ? pen.lineTo(x(t), y(v)) : pen.moveTo(x(t), y(v))));
      pen.stroke();
    }
  }

  // -- what is asked ---------------------------------------------------------------------

  pickedNow(names) {
    this.picked = names;
    find("refused").textContent = "";
    const strips = names.map((name) => {
      const old = [...find("strips").children].find((strip) => strip.dataset.name === name);
      if (old) return old;
      const strip = document.createElement("div"), head = document.createElement("header");
      const drop = Object.assign(document.createElement("button"), { textContent: "×", title: `remove ${name}` });
      drop.setAttribute("aria-label", drop.title);
      drop.addEventListener("click", () => this.ask("pick", this.picked.filter((other) => other !== name)));
      const text = document.createElement("span");
      text.append(`${name}  `, document.createElement("output"));
      head.append(text, drop);
      strip.className = "strip";
      strip.dataset.name = name;
      strip.append(head, document.createElement("canvas"));
      return strip;
    });
    find("strips").replaceChildren(...strips);
  }

  wire() {
    const add = () => {
      if (find("pick").value) this.ask("pick", [...new Set([...this.picked, find("pick").value])]);
      find("pick").value = "";
    };
    find("add").addEventListener("click", add);
    find("pick").addEventListener("keydown", (event) => { if (event.key === "Enter") add(); });
    find("play").addEventListener("click", () => this.ask(this.paused ? "play" : "pause"));
    find("step").addEventListener("click", () => this.ask("step", 0.01));
    find("speed").addEventListener("change", (event) => this.ask("speed", Number(event.target.value)));
    find("time").addEventListener("input", (event) => this.ask("seek", Number(event.target.value)));
    for (const button of document.querySelectorAll("[data-ask]")) {
      button.addEventListener("click", () => this.ask(button.dataset.ask));
    }
    for (const button of document.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => {
        const camera = this.scene?.camera;
        if (!camera) return;
        if (button.dataset.view === "follow") camera.following = !camera.following;
        else camera.look(button.dataset.view);
        document.querySelector("[data-view=follow]").setAttribute("aria-pressed", String(camera.following));
      });
    }
    document.addEventListener("keydown", (event) => {
      if (!this.seekable || ["INPUT", "SELECT"].includes(event.target.tagName) || event.ctrlKey || event.altKey) return;
      if (event.key === " " && event.target.tagName === "BUTTON") return;
      const act = {
        " ": () => this.ask(this.paused ? "play" : "pause"),
        ".": () => this.ask("step", 0.01),
        ArrowLeft: () => this.ask("seek", this.now - 1),
        ArrowRight: () => this.ask("seek", this.now + 1),
        c: () => { if (this.contact !== null) this.ask("seek", this.contact - 0.4); },
      }[event.key.length > 1 ? event.key : event.key.toLowerCase()];
      if (!act) return;
      event.preventDefault();
      act();
    });
  }
}

window.live = new Live();
