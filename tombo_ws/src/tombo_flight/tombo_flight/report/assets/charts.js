"use strict";
// Plots against time: one shared stretch of time, one shared cursor.

/** Steps of 1, 2 or 5 times a power of ten, at most `most` of them, that cover [low, high]. */
function niceTicks(low, high, most) {
  const rough = (high - low) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= rough * 0.999);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++) ticks.push(k * step);
  return { ticks, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

/** What the plots show. A series is {name, colour, values, width?, dashed?, hidden?}. */
function chartPlan(flight, milestones) {
  const take = (name, k) => {
    const { width, data } = flight[name];
    return Float32Array.from({ length: flight.count }, (_, i) => data[i * width + k]);
  };
  const angles = [[], [], []];
  for (let i = 0; i < flight.count; i++) {
    rollPitchYaw(flight.attitude.data.subarray(4 * i, 4 * i + 4)).forEach((a, k) => angles[k].push(a));
  }
  const size = (name) => Float32Array.from({ length: flight.count }, (_, i) =>
    Math.hypot(...flight[name].data.subarray(3 * i, 3 * i + 3)));
  const rotors = [["front right", "steel"], ["rear left", "pale"], ["front left", "vermillion"], ["rear right", "teal"]];
  const places = [[milestones.x_c_m, "x_c"], [milestones.x_r_m, "x_r"]].filter(([p]) => p).map(([p, name]) => ({ value: p[0], name }));
  return [
    { title: "Position", unit: "m", digits: 2, lines: places, series: [
      { name: "x", colour: "blue", values: take("position", 0), width: 2 },
      { name: "y", colour: "green", values: take("position", 1), width: 2 },
      { name: "set point x", colour: "muted", values: take("position_setpoint", 0), dashed: true },
      { name: "estimate x", colour: "blue", values: take("est_position", 0), hidden: true },
    ] },
    { title: "Height", unit: "m", digits: 2, series: [
      { name: "z", colour: "purple", values: take("position", 2), width: 2 },
      { name: "set point", colour: "muted", values: take("position_setpoint", 2), dashed: true },
      { name: "estimate", colour: "purple", values: take("est_position", 2), hidden: true },
    ] },
    { title: "Attitude", unit: "°", digits: 1, least: 12, lines: [{ value: 9.74 }, { value: -9.74 }], series: [
      { name: "roll", colour: "blue", turns: true, values: angles[0] },
      { name: "pitch", colour: "orange", turns: true, values: angles[1] },
      { name: "yaw", colour: "green", turns: true, values: angles[2] },
    ] },
    { title: "Speed", unit: "m/s", digits: 2, series: [
      { name: "speed", colour: "blue", values: size("velocity") },
      { name: "upwards", colour: "purple", values: take("velocity", 2) },
      { name: "body rate [rad/s]", colour: "orange", values: size("rates"), hidden: true },
    ] },
    { title: "Thrust", unit: "N", digits: 2, fold: take("fold", 2), series: [2, 0, 1, 3].map((k) => ({
      name: rotors[k][0], colour: rotors[k][1], values: take("rotor_thrust", k), width: k === 2 ? 2.2 : 1.1,
    })) },
  ];
}

class Charts {
  /** @param seek called with a time when the reader picks one @param hover with a time or null */
  constructor(root, flight, milestones, { seek, hover }) {
    Object.assign(this, { flight, milestones, seek, hover });
    this.left = 42;
    this.right = 10;
    this.charts = chartPlan(flight, milestones).map((plan) => this.build(root, plan));
    this.show(0, milestones.duration_s);
  }

  build(root, plan) {
    const make = (tag, className, parent) => {
      const node = document.createElement(tag);
      if (className) node.className = className;
      parent.append(node);
      return node;
    };
    const box = make("div", "chart", root), legend = make("div", "legend", box), plot = make("div", "plot", box);
    const chart = { ...plan, box, plot, base: make("canvas", "", plot), over: make("canvas", "", plot) };
    chart.over.setAttribute("aria-label", `${plan.title} against time`);
    make("b", "", legend).textContent = `${plan.title} [${plan.unit}]`;
    for (const series of chart.series) {
      const key = make("button", "", legend), dash = make("i", series.dashed ? "dashed" : "", key);
      key.append(series.name);
      key.setAttribute("aria-pressed", String(!series.hidden));
      key.title = "show or hide";
      Object.assign(series, { key, dash, output: make("output", "", key) });
      key.addEventListener("click", () => {
        series.hidden = !series.hidden;
        key.setAttribute("aria-pressed", String(!series.hidden));
        this.draw();
      });
    }
    this.listen(plot);
    return chart;
  }

  /** Point to read, click to seek, drag to zoom; a finger seeks, so that the page can scroll. */
  listen(plot) {
    const timeAt = (event) => {
      const box = plot.getBoundingClientRect(), inner = box.width - this.left - this.right;
      return clamp(this.start + ((event.clientX - box.left - this.left) / inner) * (this.end - this.start), this.start, this.end);
    };
    let from = null;
    plot.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "mouse" && event.button !== 0) return;
      plot.setPointerCapture(event.pointerId);
      from = { x: event.clientX, time: timeAt(event) };
      if (event.pointerType !== "mouse") this.seek(timeAt(event));
    });
    plot.addEventListener("pointermove", (event) => {
      const time = timeAt(event);
      if (event.pointerType !== "mouse") { if (from) this.seek(time); return; }
      const dragged = from && Math.abs(event.clientX - from.x) > 5;
      this.selection = dragged ? [Math.min(from.time, time), Math.max(from.time, time)] : null;
      this.hover(time);
    });
    plot.addEventListener("pointerup", (event) => {
      if (this.selection && this.selection[1] - this.selection[0] > 0.02) this.show(...this.selection);
      else if (from) this.seek(timeAt(event));
      from = this.selection = null;
      this.hover(null);
    });
    plot.addEventListener("pointerleave", () => { if (!from) this.hover(null); });
    plot.addEventListener("pointercancel", () => { from = this.selection = null; this.hover(null); });
    plot.addEventListener("dblclick", () => this.show(0, this.milestones.duration_s));
  }

  /** Show the stretch [start, end] of time. */
  show(start, end) {
    this.start = start;
    this.end = Math.max(end, start + 1e-3);
    if (this.paint) this.draw();
    if (this.changed) this.changed();
  }

  readColours(colour) {
    this.paint = colour;
    for (const { series } of this.charts) for (const s of series) s.dash.style.borderColor = colour(s.colour);
    this.draw();
  }

  size(canvas) {
    const sharp = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * sharp)) canvas.width = Math.round(width * sharp);
    if (canvas.height !== Math.round(height * sharp)) canvas.height = Math.round(height * sharp);
    const pen = canvas.getContext("2d");
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    pen.clearRect(0, 0, width, height);
    return { pen, width, height };
  }

  x(time, width) {
    return this.left + ((time - this.start) / (this.end - this.start)) * (width - this.left - this.right);
  }

  draw() {
    for (const chart of this.charts) this.drawChart(chart, chart === this.charts.at(-1));
    this.drawCursor();
  }

  drawChart(chart, last) {
    const { pen, width, height } = this.size(chart.base), { milestones, flight } = this, colour = this.paint;
    const top = 6, bottom = height - (last ? 24 : 5), first = indexAt(flight.t, this.start);
    const stop = Math.min(indexAt(flight.t, this.end) + 1, flight.count - 1);
    let low = Infinity, high = -Infinity;
    for (const { values, hidden } of chart.series) {
      for (let i = first; i <= stop && !hidden; i++) {
        if (values[i] < low) low = values[i];
        if (values[i] > high) high = values[i];
      }
    }
    if (!(low <= high)) [low, high] = [0, 1];
    if (chart.least) [low, high] = [Math.min(low, -chart.least), Math.max(high, chart.least)];
    const margin = Math.max((high - low) * 0.08, 0.02);
    chart.scale = { low: low - margin, high: high + margin, top, bottom };
    const x = (t) => this.x(t, width), y = (v) => this.y(chart, v), right = width - this.right;

    pen.save();
    pen.beginPath();
    pen.rect(this.left, top, right - this.left, bottom - top);
    pen.clip();
    for (const [from, to, name] of [
      [milestones.contact_s, milestones.unstable_end_s, "unstable"], [milestones.unstable_end_s, milestones.recovery_end_s, "recovery"],
    ]) {
      if (from === null || to === null) continue;
      pen.fillStyle = colour(name);
      pen.fillRect(x(from), top, x(to) - x(from), bottom - top);
    }
    pen.restore();

    pen.font = `11px ${getComputedStyle(document.body).fontFamily}`;
    pen.fillStyle = colour("muted");
    pen.strokeStyle = colour("line");
    pen.lineWidth = 1;
    const rows = niceTicks(chart.scale.low, chart.scale.high, 5);
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const tick of rows.ticks) {
      this.line(pen, this.left, y(tick), right, y(tick));
      if (y(tick) > top + 4 || last) pen.fillText(tick.toFixed(rows.digits).replace("-", "−"), this.left - 6, y(tick));
    }
    // Around the contact the axis counts from it, as the paper's figure does.
    const near = milestones.mark_s !== null && this.end - this.start < 20;
    const zero = near && this.start < milestones.mark_s && milestones.mark_s < this.end ? milestones.mark_s : 0;
    const columns = niceTicks(this.start - zero, this.end - zero, Math.max(3, (right - this.left) / 62));
    pen.textAlign = "center";
    pen.textBaseline = "top";
    for (const tick of columns.ticks) {
      const at = x(tick + zero);
      this.line(pen, at, top, at, bottom);
      const label = (zero && tick > 0 ? "+" : "") + tick.toFixed(columns.digits).replace("-", "−");
      if (last) pen.fillText(`${label} s`, clamp(at, this.left + 8, right - 12), bottom + 6);
    }

    pen.save();
    pen.beginPath();
    pen.rect(this.left, top - 2, right - this.left, bottom - top + 4);
    pen.clip();
    for (const { value, name } of chart.lines || []) {
      pen.setLineDash([5, 4]);
      pen.strokeStyle = colour("muted");
      this.line(pen, this.left, y(value), right, y(value));
      pen.setLineDash([]);
      if (!name) continue;
      const [stem, index] = name.split("_"), level = y(value) + (y(value) < top + 16 ? 8 : -6);
      pen.textAlign = "left";
      pen.textBaseline = "middle";
      pen.fillStyle = colour("muted");
      pen.fillText(stem, this.left + 5, level);
      pen.fillText(index, this.left + 12, level + 3);
    }
    const instants = [[milestones.contact_s, "ink"], [milestones.detection_s, "purple"], [milestones.switch_s, "green"],
      [milestones.crash_s, "vermillion"]];
    for (const [time, name] of instants) {
      if (time === null) continue;
      pen.strokeStyle = colour(name);
      this.line(pen, x(time), top, x(time), bottom);
    }
    if (chart.fold) this.drawFold(pen, chart, x, first, stop);
    for (const s of [...chart.series].reverse()) if (!s.hidden) this.drawSeries(pen, s, x, y, first, stop);
    pen.restore();
  }

  y(chart, value) {
    const { low, high, top, bottom } = chart.scale;
    return bottom - ((value - low) / (high - low)) * (bottom - top);
  }

  line(pen, x0, y0, x1, y1) {
    const crisp = (v) => Math.round(v) + 0.5;
    pen.beginPath();
    pen.moveTo(crisp(x0), crisp(y0));
    pen.lineTo(crisp(x1), crisp(y1));
    pen.stroke();
  }

  drawFold(pen, chart, x, first, stop) {
    const { top, bottom } = chart.scale, { t } = this.flight;
    pen.beginPath();
    pen.moveTo(x(t[first]), bottom);
    for (let i = first; i <= stop; i++) pen.lineTo(x(t[i]), bottom - chart.fold[i] * (bottom - top));
    pen.lineTo(x(t[stop]), bottom);
    pen.globalAlpha = 0.2;
    pen.fillStyle = this.paint("vermillion");
    pen.fill();
    pen.globalAlpha = 1;
  }

  drawSeries(pen, series, x, y, first, stop) {
    const { t } = this.flight;
    pen.beginPath();
    // An angle that passes from one end to the other breaks the line; a gap in the data too.
    for (let i = first, last = NaN; i <= stop; last = series.values[i++]) {
      const step = Math.abs(series.values[i] - last), joined = series.turns ? step < 180 : step >= 0;
      if (joined) pen.lineTo(x(t[i]), y(series.values[i])); else pen.moveTo(x(t[i]), y(series.values[i]));
    }
    pen.setLineDash(series.dashed ? [5, 3] : []);
    pen.strokeStyle = this.paint(series.colour);
    pen.lineWidth = series.width || 1.4;
    pen.lineJoin = "round";
    pen.stroke();
    pen.setLineDash([]);
  }

  /** Move the cursor to `time` and the cross-hair to `pointed` (a time or null). */
  cursor(time, pointed) {
    Object.assign(this, { time, pointed });
    this.drawCursor();
  }

  drawCursor() {
    if (this.time === undefined || !this.paint) return;
    const read = this.pointed ?? this.time, i = indexAt(this.flight.t, read);
    for (const chart of this.charts) {
      const { pen, width } = this.size(chart.over), { top, bottom } = chart.scale;
      if (this.selection) {
        pen.globalAlpha = 0.18;
        pen.fillStyle = this.paint("accent");
        const [from, to] = this.selection.map((time) => this.x(time, width));
        pen.fillRect(from, top, to - from, bottom - top);
        pen.globalAlpha = 1;
      }
      for (const [time, name, dash] of [[this.time, "accent", []], [this.pointed, "muted", [3, 3]]]) {
        if (time === null || time < this.start || time > this.end) continue;
        pen.setLineDash(dash);
        pen.strokeStyle = this.paint(name);
        pen.lineWidth = dash.length ? 1 : 2;
        this.line(pen, this.x(time, width), top, this.x(time, width), bottom);
      }
      for (const series of chart.series) {
        const value = series.values[i];
        series.output.textContent = Number.isFinite(value) ? value.toFixed(chart.digits).replace("-", "−") : "–";
        if (!Number.isFinite(value) || series.hidden || read < this.start || read > this.end) continue;
        pen.beginPath();
        pen.arc(this.x(read, width), this.y(chart, value), 3, 0, TURN);
        pen.fillStyle = this.paint(series.colour);
        pen.fill();
      }
    }
  }
}
