"use strict";
// Knobs are sent as they turn; the newest answer is drawn. Nothing is computed here.

const data = JSON.parse(document.getElementById("data").textContent);
const find = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") || "";
const KNOBS = ["fibres", "fibre_diameter_mm", "length_mm", "outer_radius_mm"];
const VEHICLE = ["mass_kg", "arm_mm", "min_thrust_margin", "max_collision_force_N", "max_recovery_s", "max_noise_dB"];
const FIGURES = { thrust_margin: ["thrust margin", ""], collision_force_N: ["force", "N"], recovery_s: ["recovery", "s"],
  noise_dB: ["noise", "dB"], lift_over_drag: ["lift over drag", ""] };
const KNOWN = { measured: "green", modelled: "blue", extrapolated: "vermillion" };
const LEFT = 46, RIGHT = 8, TOP = 8, BOTTOM = 20;
if (token) history.replaceState(null, "", location.pathname);

const address = (path) => `${path}?token=${encodeURIComponent(token)}`;

/** Ask the server; resolves to its answer, or throws what it refuses. */
async function ask(what, values) {
  const response = await fetch(address(`ask/${what}`), {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(values),
  });
  if (response.headers.get("Content-Disposition")) return response;
  const answer = await response.json().catch(() => ({ error: `no answer (${response.status})` }));
  if (answer.error) throw new Error(answer.error);
  return answer;
}

/** The propeller as it is described by the form. */
function propeller() {
  const blade = find("blade").value, values = { blade, soft: find("soft").checked };
  if (!values.soft) return values;
  values.matrix = find("matrix").value;
  values.fibre = find("fibre").value;
  for (const name of KNOBS) values[name] = Number(find(name).value);
  return values;
}

/** The vehicle as it is described; what is empty has the server's default. */
function vehicle() {
  const values = { law: find("law").value, extrapolate: find("extrapolate").checked };
  for (const name of VEHICLE) if (find(name).value) values[name] = Number(find(name).value);
  return values;
}

class Bench {
  constructor() {
    this.wire();
    this.setKnobs(data.knobs[find("blade").value]);
    this.refresh();
    new ResizeObserver(() => this.draw()).observe(find("panels"));
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  wire() {
    const form = find("knobs");
    form.addEventListener("submit", (event) => event.preventDefault());
    form.addEventListener("input", (event) => this.changed(event.target));
    find("vehicle").addEventListener("submit", (event) => event.preventDefault());
    find("recommend").addEventListener("click", () => this.work("design", "searching candidates", (answer) => this.showDesign(answer)));
    find("fly").addEventListener("click", () => this.work("fly", "flying", (answer) => this.showFlight(answer)));
    find("library").addEventListener("click", () => this.work("library", "writing", save));
  }

  changed(input) {
    if (input.id === "speed") return this.draw();
    if (input.id === "conf" && input.value) this.setKnobs(data.configurations[input.value]);
    if (input.id === "blade") {
      this.setKnobs(data.knobs[input.value]);
      find("extrapolate").checked = !data.measured_blades.includes(input.value);
    }
    if (!["conf", "soft", "top"].includes(input.id)) find("conf").value = "";
    find("nodus").disabled = !find("soft").checked;
    this.showKnobs();
    this.refresh();
  }

  setKnobs(values) {
    for (const name of KNOBS) find(name).value = values[name];
    if (values.matrix) { find("matrix").value = values.matrix; find("fibre").value = values.fibre; }
    this.showKnobs();
  }

  showKnobs() {
    for (const name of KNOBS) {
      const input = find(name);
      find(`${name}-shown`).textContent = `${input.value} ${input.dataset.unit}`;
    }
  }

  /** Ask for new curves; while an answer is awaited only the newest state is kept. */
  async refresh() {
    this.stale = true;
    if (this.asking) return;
    this.asking = true;
    document.documentElement.dataset.state = "asking";
    while (this.stale) {
      this.stale = false;
      const turned = performance.now();
      try {
        this.show(await ask("curves", { propeller: propeller(), top_rpm: Number(find("top").value) }));
        this.refuse("");
        document.documentElement.dataset.lag = (performance.now() - turned).toFixed(1);
      } catch (error) {
        this.refuse(error.message);
      }
    }
    this.asking = false;
    document.documentElement.dataset.state = "ready";
  }

  refuse(text) { find("refused").textContent = text; }

  show(curves) {
    this.curves = curves;
    find("label").textContent = curves.label;
    find("top").max = find("speed").max = curves.highest_rpm;
    find("top-shown").textContent = `${curves.rpm.at(-1).toFixed(0)} rpm`;
    find("figures").replaceChildren(...curves.figures.map(card));
    find("laws").textContent = Object.values(curves.refused).join(" ");
    for (const line of document.querySelectorAll("[data-law]")) {
      const none = line.dataset.law in curves.refused;
      line.classList.toggle("none", none);
      line.querySelector("small").textContent = none ? " no published figures for this blade" : "";
    }
    if (find("panels").children.length !== curves.panels.length) {
      find("panels").replaceChildren(...curves.panels.map(panelBox));
    }
    this.draw();
  }

  /** Ask for what takes longer, one thing at a time. */
  async work(what, doing, show) {
    const buttons = ["recommend", "fly", "library"].map(find), began = performance.now();
    for (const button of buttons) button.disabled = true;
    find("busy").textContent = `${doing} …`;
    find("told").textContent = "";
    try {
      await show(await ask(what, { propeller: propeller(), vehicle: vehicle(), top_rpm: Number(find("top").value) }));
      find("busy").textContent = `done in ${((performance.now() - began) / 1000).toFixed(1)} s`;
    } catch (error) {
      find("told").textContent = error.message;
      find("busy").textContent = "";
    }
    for (const button of buttons) button.disabled = false;
  }

  showDesign({ headline, why, candidates, page }) {
    const rows = candidates.map((candidate, i) => this.candidate(candidate, i === 0));
    const head = element("tr", "", ...["nodus", ...Object.values(FIGURES).map(([words, unit]) => `${words} ${unit}`), ""].map((text) => element("th", "", text)));
    const fronts = Object.entries(FIGURES).slice(1).map(([name, [words, unit]]) => this.frontBox(name, words, unit));
    this.front = { candidates, best: candidates[0] };
    find("answer").replaceChildren(element("h2", "", headline), link(page, "Design page with all candidates"),
      element("div", "grid fronts", ...fronts), knownLegend(), ...why.map((text) => element("p", "aside", text)),
      rows.length ? element("table", "", element("thead", "", head), element("tbody", "", ...rows)) : "");
    this.draw();
  }

  frontBox(name, words, unit) {
    const box = element("section", "panel", element("h2", "", `${words}${unit && ` [${unit}]`}`), element("canvas", ""));
    box.dataset.figure = name;
    box.lastChild.setAttribute("role", "img");
    box.lastChild.setAttribute("aria-label", `Candidates: ${words} against thrust margin`);
    return box;
  }

  candidate(candidate, best) {
    const cells = Object.keys(FIGURES).map((name) => {
      const { value, low, high, known } = candidate.figures[name];
      const span = high > low ? ` ${low.toPrecision(3)} to ${high.toPrecision(3)}` : "";
      return element("td", "", value === null ? "–" : value.toPrecision(3), element("small", "", known + span));
    });
    const use = element("button", "", "Use"), fly = element("button", "", "Fly it");
    use.addEventListener("click", () => this.use(candidate));
    fly.addEventListener("click", () => { this.use(candidate); find("fly").click(); });
    return element("tr", best ? "best" : "", element("th", "", candidate.name, element("small", "", best ? " recommended" : "")), ...cells, element("td", "", use, " ", fly));
  }

  /** Turn the knobs to a candidate. */
  use(candidate) {
    find("soft").checked = true;
    find("nodus").disabled = false;
    this.setKnobs(candidate);
    this.refresh();
  }

  showFlight({ collided, crashed, recovery_time_s, max_falling_distance_m, force_N, force_capped, page }) {
    const how = !collided ? "It does not touch the pillar" : crashed ? "It crashes" : recovery_time_s === null ? "It does not settle" : `It recovers in ${recovery_time_s.toFixed(2)} s`;
    const falls = max_falling_distance_m === null ? "" : `, falls ${max_falling_distance_m.toFixed(2)} m`;
    const force = `; struck with ${force_N.toFixed(0)} N${force_capped ? ", the most that the simulator takes: the model says more" : ""}.`;
    this.front = null;
    find("answer").replaceChildren(element("h2", "", `${how}${falls}${force}`), link(page, "Report with the 3-D replay"));
  }

  draw() {
    if (!this.curves) return;
    const { rpm, panels } = this.curves, speed = Math.min(Number(find("speed").value), rpm.at(-1));
    find("speed-shown").textContent = `${speed.toFixed(0)} rpm`;
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    panels.forEach((panel, i) => drawPanel(find("panels").children[i], panel, rpm, speed, colour));
    if (this.front) for (const box of document.querySelectorAll("[data-figure]")) drawFront(box, this.front, colour);
  }
}

function element(tag, className, ...content) {
  const node = document.createElement(tag);
  if (className) node.className = className;
  node.append(...content);
  return node;
}

function link(page, text) {
  const anchor = element("a", "", text);
  anchor.href = address(`page/${page}`);
  anchor.target = "_blank";
  anchor.rel = "noopener";
  return element("p", "", anchor);
}

/** Save the file that a response holds. */
async function save(response) {
  const [, name] = response.headers.get("Content-Disposition").match(/filename="(.*)"/);
  const anchor = element("a", "");
  anchor.href = URL.createObjectURL(await response.blob());
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 1000);
}

const plainNumber = (value) => (Math.abs(value) >= 1000 ? value.toFixed(0) : value.toPrecision(4));

function card({ name, value, unit, known, beside }) {
  return element("div", "card", element("span", "name", name),
    element("span", "value", plainNumber(value), " ", element("small", "", unit)),
    element("span", "beside", `${beside} · ${known}`));
}

function panelBox(panel) {
  const box = element("section", "panel", element("h2", "", element("span", ""), element("output", "")),
    element("canvas", ""), element("p", "known"));
  box.querySelector("canvas").setAttribute("role", "img");
  box.querySelector("canvas").addEventListener("pointermove", (event) => {
    const area = event.currentTarget.getBoundingClientRect();
    const share = (event.clientX - area.left - LEFT) / (area.width - LEFT - RIGHT);
    find("speed").value = Math.max(0, Math.min(1, share)) * bench.curves.rpm.at(-1);
    bench.draw();
  });
  return box;
}

const colourOf = (curve) => data.colours[curve.name] || "purple";

/** The value of a curve at a speed, between its points. */
function valueAt(rpm, values, speed) {
  const at = (speed / rpm.at(-1)) * (rpm.length - 1), i = Math.min(Math.floor(at), rpm.length - 2);
  const [a, b] = [values[i], values[i + 1]];
  return a === null || b === null ? null : a + (at - i) * (b - a);
}

function drawPanel(box, panel, rpm, speed, colour) {
  const unit = panel.unit ? ` [${panel.unit}]` : "", canvas = box.querySelector("canvas");
  box.querySelector("h2 span").textContent = panel.title + unit;
  box.querySelector(".known").textContent = panel.known;
  canvas.setAttribute("aria-label", `${panel.title} against rotor speed`);
  const output = box.querySelector("output");
  output.replaceChildren(...panel.curves.map((curve) => {
    const value = valueAt(rpm, curve.values, speed), text = element("span", "", value === null ? "–" : value.toPrecision(3));
    text.style.color = colour(colourOf(curve));
    return text;
  }));
  const { pen, width, height } = cleared(canvas);
  const all = panel.curves.flatMap((c) => [...c.values, ...(c.low || []), ...(c.high || [])]);
  all.push(...panel.readings.map((r) => r.value + (r.deviation || 0)));
  const numbers = all.filter((v) => v !== null), low = Math.min(...numbers, ...(panel.unit ? [0] : []));
  const high = Math.max(...numbers, low + 1e-3);
  const x = (v) => LEFT + (v / rpm.at(-1)) * (width - LEFT - RIGHT);
  const y = (v) => height - BOTTOM - ((v - low) / (high - low)) * (height - TOP - BOTTOM);
  axes(pen, { low, high, start: 0, top: rpm.at(-1), unit: " rpm" }, { x, y, width, height }, colour);
  for (const curve of panel.curves) {
    if (curve.low) band(pen, rpm, curve, x, y, colour(colourOf(curve)));
  }
  for (const curve of panel.curves) {
    pen.strokeStyle = colour(colourOf(curve));
    pen.lineWidth = 1.7;
    trace(pen, rpm, curve.values, x, y);
    pen.stroke();
  }
  for (const reading of panel.readings) point(pen, reading, x, y, colour);
  pen.strokeStyle = colour("accent");
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(x(speed), TOP);
  pen.lineTo(x(speed), height - BOTTOM);
  pen.stroke();
}

/** The candidates' figure against their thrust margin, in the colour of how it is known. */
function drawFront(box, { candidates, best }, colour) {
  const { pen, width, height } = cleared(box.querySelector("canvas")), name = box.dataset.figure;
  const points = candidates.map((candidate) => ({ best: candidate === best, margin: candidate.figures.thrust_margin.value, ...candidate.figures[name] }))
    .filter(({ margin, value }) => margin !== null && value !== null);
  if (!points.length) return;
  const span = (values) => {
    const low = Math.min(...values), high = Math.max(...values), more = 0.08 * (high - low) || 0.05 * Math.abs(high) || 1;
    return [low - more, high + more];
  };
  const [start, top] = span(points.map(({ margin }) => margin));
  const [low, high] = span(points.flatMap((p) => [p.value, p.low ?? p.value, p.high ?? p.value]));
  const x = (v) => LEFT + ((v - start) / (top - start)) * (width - LEFT - RIGHT);
  const y = (v) => height - BOTTOM - ((v - low) / (high - low)) * (height - TOP - BOTTOM);
  axes(pen, { low, high, start, top, unit: " thrust margin" }, { x, y, width, height }, colour);
  for (const point of points) {
    pen.strokeStyle = pen.fillStyle = colour(KNOWN[point.known] || "ink");
    pen.lineWidth = 1;
    pen.beginPath();
    if (point.high > point.low) { pen.moveTo(x(point.margin), y(point.low)); pen.lineTo(x(point.margin), y(point.high)); }
    pen.stroke();
    pen.beginPath();
    pen.arc(x(point.margin), y(point.value), 3.5, 0, 2 * Math.PI);
    pen.fill();
    if (!point.best) continue;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(x(point.margin), y(point.value), 8, 0, 2 * Math.PI);
    pen.stroke();
  }
}

function knownLegend() {
  const lines = Object.entries(KNOWN).map(([name, colour]) => {
    const dot = element("i", "dot");
    dot.style.background = `var(--${colour})`;
    return element("li", "", dot, name);
  });
  return element("ul", "legend", ...lines, element("li", "", "ring: recommended; line: interval"));
}

/** A canvas's pen, its content gone, in CSS pixels. */
function cleared(canvas) {
  const sharp = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = width * sharp;
  canvas.height = height * sharp;
  const pen = canvas.getContext("2d");
  pen.setTransform(sharp, 0, 0, sharp, 0, 0);
  pen.font = "10px system-ui, sans-serif";
  return { pen, width, height };
}

function axes(pen, { low, high, start, top, unit }, { x, y, width, height }, colour) {
  const rows = niceTicks(low, high, 4), columns = niceTicks(start, top, Math.max(2, width / 75));
  pen.lineWidth = 1;
  pen.strokeStyle = colour("line");
  pen.fillStyle = colour("muted");
  pen.textAlign = "right";
  for (const tick of rows.ticks) {
    pen.fillText(tick.toFixed(rows.digits), LEFT - 5, y(tick) + 3);
    pen.beginPath();
    pen.moveTo(LEFT, y(tick));
    pen.lineTo(width - RIGHT, y(tick));
    pen.stroke();
  }
  pen.textAlign = "center";
  columns.ticks.forEach((tick, i) => {
    const text = tick.toFixed(columns.digits) + (i === columns.ticks.length - 1 ? unit : "");
    pen.fillText(text, Math.min(x(tick), width - 2 - pen.measureText(text).width / 2), height - 5);
  });
}

function trace(pen, rpm, values, x, y) {
  pen.beginPath();
  let joined = false;
  values.forEach((v, i) => {
    if (v !== null) { if (joined) pen.lineTo(x(rpm[i]), y(v)); else pen.moveTo(x(rpm[i]), y(v)); }
    joined = v !== null;
  });
}

function band(pen, rpm, curve, x, y, fill) {
  const known = rpm.map((_, i) => i).filter((i) => curve.low[i] !== null && curve.high[i] !== null);
  if (!known.length) return;
  pen.beginPath();
  known.forEach((i) => pen.lineTo(x(rpm[i]), y(curve.high[i])));
  known.reverse().forEach((i) => pen.lineTo(x(rpm[i]), y(curve.low[i])));
  pen.closePath();
  pen.globalAlpha = 0.16;
  pen.fillStyle = fill;
  pen.fill();
  pen.globalAlpha = 1;
}

function point(pen, { rpm, value, deviation, chosen }, x, y, colour) {
  pen.globalAlpha = chosen ? 1 : 0.3;
  pen.fillStyle = pen.strokeStyle = colour("ink");
  pen.beginPath();
  pen.arc(x(rpm), y(value), chosen ? 4 : 2.5, 0, 2 * Math.PI);
  pen.fill();
  if (deviation && chosen) {
    pen.beginPath();
    pen.moveTo(x(rpm), y(value - deviation));
    pen.lineTo(x(rpm), y(value + deviation));
    pen.stroke();
  }
  pen.globalAlpha = 1;
}

const bench = new Bench();
