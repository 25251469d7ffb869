"use strict";
// The vehicle in space, drawn on a plain canvas: far things first, near things last.

const TRAIL_STEP_M = 0.012;
const LIGHT_FROM = -2.16;
const FRONT_LEFT = 2;

class Scene {
  /** @param canvas where to draw @param flight decoded columns @param milestones of the flight */
  constructor(canvas, flight, milestones) {
    Object.assign(this, { canvas, flight, milestones });
    this.pen = canvas.getContext("2d");
    this.trail = this.thinTrail();
    this.camera = new Camera(canvas, this.trail.map(({ p }) => p), milestones);
  }

  /** Re-read the colours of the page, which follow the system's light or dark scheme. */
  readColours() {
    const page = getComputedStyle(document.documentElement);
    this.colour = (name) => page.getPropertyValue("--" + name).trim();
    this.paint = {};
    for (const name of ["ink", "muted", "blue", "green", "vermillion", "purple", "steel", "teal",
      "sky-top", "sky-low", "grid", "shadow", "pole", "frame", "deck", "leg", "motor", "panel"]) {
      this.paint[name] = this.colour(name);
    }
  }

  // -- one picture -----------------------------------------------------------------------

  /** Draw the flight at `time` [s]. */
  draw(time) {
    const { canvas, pen, flight, milestones } = this, sharp = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * sharp) || canvas.height !== Math.round(height * sharp)) {
      canvas.width = Math.round(width * sharp);
      canvas.height = Math.round(height * sharp);
    }
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    pen.lineCap = pen.lineJoin = "round";
    this.camera.follow(rowAt(flight, "position", time));
    this.eye = this.camera.axes.eye;
    this.see = this.camera.projection(width, height);

    const sky = pen.createLinearGradient(0, 0, 0, height);
    sky.addColorStop(0, this.paint["sky-top"]);
    sky.addColorStop(1, this.paint["sky-low"]);
    pen.fillStyle = sky;
    pen.fillRect(0, 0, width, height);

    const parts = vehicleParts(flight, milestones.shape, time, this.eye);
    this.drawGround();
    this.drawShadows(parts);
    this.drawTrail(time, true);
    const behind = parts.filter((part) => this.isBehind(part.points[0]));
    this.drawParts(behind);
    this.drawMarkers(true);
    this.drawPole();
    this.drawMarkers(false);
    this.drawTrail(time, false);
    this.drawParts(parts.filter((part) => !behind.includes(part)));
    this.drawBlow(time, parts);
  }

  stroke(points, colour, width, dash = []) {
    const { pen } = this;
    pen.beginPath();
    let down = false;
    for (const p of points) {
      const [x, y, depth] = this.see(p);
      if (depth < 0.06) { down = false; continue; }
      if (down) pen.lineTo(x, y); else pen.moveTo(x, y);
      down = true;
    }
    pen.setLineDash(dash);
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
    pen.setLineDash([]);
  }

  fill(points, colour, alpha = 1) {
    const { pen } = this, seen = points.map(this.see);
    if (seen.some((p) => p[2] < 0.06)) return;
    pen.beginPath();
    seen.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.closePath();
    pen.globalAlpha = alpha;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = 1;
  }

  /** Whether a point is farther than the obstacle's axis, so that the obstacle may hide it. */
  isBehind(p) {
    const o = this.milestones.obstacle;
    if (!o) return false;
    const far = (x, y) => Math.hypot(x - this.eye[0], y - this.eye[1]);
    return far(p[0], p[1]) > far(o.x_m, o.y_m);
  }

  drawGround() {
    const { pen } = this, [cx, cy] = this.camera.now.target.map(Math.round), reach = 9;
    const faint = Array.from({ length: 5 }, () => new Path2D());
    for (let k = -reach; k <= reach; k += 0.5) {
      for (let a = -reach; a < reach; a += 1) {
        const fade = 1 - Math.hypot(k, a + 0.5) / reach;
        if (fade <= 0) continue;
        const along = [[cx + k, cy + a, 0], [cx + k, cy + a + 1, 0]];
        const over = [[cx + a, cy + k, 0], [cx + a + 1, cy + k, 0]];
        for (const [s, e] of [along.map(this.see), over.map(this.see)]) {
          if (s[2] < 0.1 || e[2] < 0.1) continue;
          const path = faint[Math.min(4, Math.floor(fade * 5))];
          path.moveTo(s[0], s[1]);
          path.lineTo(e[0], e[1]);
        }
      }
    }
    pen.lineWidth = 1;
    faint.forEach((path, i) => {
      pen.strokeStyle = `rgb(${this.paint.grid} / ${0.07 + 0.09 * i})`;
      pen.stroke(path);
    });
    // Where east and north are, and how long a metre is.
    const corner = [cx - 1.5, cy - 1.5, 0];
    for (const [way, name] of [[[1, 0, 0], "x east"], [[0, 1, 0], "y north"]]) {
      this.arrow(corner, add(corner, way), this.paint.muted, 1.5);
      const [x, y, depth] = this.see(add(corner, scaled(way, 1.12)));
      if (depth > 0.1) this.text(name, x, y, this.paint.muted, 11);
    }
  }

  drawShadows(parts) {
    for (const { kind, points } of parts) {
      if (kind === "disc") this.fill(points.map(([x, y]) => [x, y, 0]), this.paint.shadow, 0.8);
    }
  }

  drawPole() {
    const o = this.milestones.obstacle;
    if (!o) return;
    const at = (angle, z) => [o.x_m + o.radius_m * Math.cos(angle), o.y_m + o.radius_m * Math.sin(angle), z];
    const tint = (glow) => `rgb(${this.paint.pole.split(" ").map((c) => Math.min(255, c * glow)).join(" ")})`;
    const east = this.eye[0] - o.x_m, north = this.eye[1] - o.y_m, far = Math.hypot(east, north);
    if (far > o.radius_m) {
      // The visible half as one shape, shaded from silhouette to silhouette.
      const towards = Math.atan2(north, east), half = Math.acos(o.radius_m / far);
      const angles = Array.from({ length: 17 }, (_, k) => towards + half * (k / 8 - 1));
      const level = clamp(this.camera.now.target[2], 0, o.top_m);
      const [from, to] = [angles[0], angles[16]].map((angle) => this.see(at(angle, level)));
      const glow = this.pen.createLinearGradient(from[0], from[1], to[0], to[1]);
      for (const angle of angles) {
        const across = 0.5 + 0.5 * Math.sin(angle - towards) / Math.sin(half);
        const lit = Math.max(0, Math.cos(angle - LIGHT_FROM));
        glow.addColorStop(clamp(across, 0, 1), tint(0.72 + 0.45 * lit));
      }
      const side = [...angles.map((angle) => at(angle, 0)), ...angles.map((angle) => at(angle, o.top_m)).reverse()];
      this.fill(side, glow);
    }
    if (this.eye[2] > o.top_m) this.fill(ring([o.x_m, o.y_m, o.top_m], o.radius_m), tint(1));
  }

  // -- the path --------------------------------------------------------------------------

  thinTrail() {
    const { flight, milestones } = this, { data } = flight.position, trail = [];
    const marks = [milestones.contact_s, milestones.unstable_end_s, milestones.recovery_end_s].filter((t) => t !== null);
    let last = null, stage = -1;
    for (let i = 0; i < flight.count; i++) {
      const p = [data[3 * i], data[3 * i + 1], data[3 * i + 2]], t = flight.t[i];
      const now = marks.filter((m) => t >= m - 1e-4).length;
      if (last && now === stage && i < flight.count - 1 && Math.hypot(...sub(p, last)) < TRAIL_STEP_M) continue;
      trail.push({ t, p, stage: now });
      last = p;
      stage = now;
    }
    return trail;
  }

  drawTrail(time, behind) {
    const { paint, trail } = this, crashed = this.milestones.verdict === "crashed";
    const colours = crashed
      ? [paint.blue, paint.vermillion, paint.vermillion, paint.vermillion]
      : [paint.blue, paint.vermillion, paint.purple, paint.green];
    const cut = trail.findIndex((point) => point.t > time), next = cut < 0 ? trail.length : cut;
    const now = { t: time, p: rowAt(this.flight, "position", time), stage: trail[Math.max(next - 1, 0)].stage };
    const points = [...trail.slice(0, next), now, ...trail.slice(next)];
    const kind = (i) => (this.isBehind(points[i].p) === behind ? points[i].stage + (i < next ? "+" : "-") : "");
    for (let start = 0, i = 1; i < points.length; i++) {
      if (i < points.length - 1 && kind(i) === kind(start)) continue;
      if (kind(start)) {
        const past = kind(start).endsWith("+");
        this.pen.globalAlpha = past ? 0.95 : 0.35;
        this.stroke(points.slice(start, i + 1).map(({ p }) => p), colours[points[start].stage], past ? 2.6 : 1.4);
        this.pen.globalAlpha = 1;
      }
      start = i;
    }
  }

  // -- marks -----------------------------------------------------------------------------

  arrow(from, to, colour, width) {
    const a = this.see(from), b = this.see(to), { pen } = this;
    if (a[2] < 0.06 || b[2] < 0.06) return;
    const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (length < 1.5) return;
    const head = Math.min(3.6 * width + 2, length * 0.6), angle = Math.atan2(b[1] - a[1], b[0] - a[0]);
    const at = (back, side) => [
      b[0] - head * back * Math.cos(angle) + head * side * Math.sin(angle),
      b[1] - head * back * Math.sin(angle) - head * side * Math.cos(angle),
    ];
    pen.strokeStyle = pen.fillStyle = colour;
    pen.lineWidth = width;
    pen.beginPath();
    pen.moveTo(a[0], a[1]);
    pen.lineTo(...at(0.9, 0));
    pen.stroke();
    pen.beginPath();
    pen.moveTo(b[0], b[1]);
    pen.lineTo(...at(1, 0.42));
    pen.lineTo(...at(1, -0.42));
    pen.fill();
  }

  /** Text centred at (x, y); "x_c" is set with a small lowered c. */
  text(words, x, y, colour, size) {
    const { pen } = this, [stem, index] = words.split("_"), font = getComputedStyle(document.body).fontFamily;
    pen.fillStyle = colour;
    pen.textAlign = index ? "right" : "center";
    pen.textBaseline = "middle";
    pen.lineWidth = 3;
    pen.strokeStyle = this.paint["sky-low"];
    const put = (what, px, py, style) => {
      pen.font = style;
      pen.strokeText(what, px, py);
      pen.fillText(what, px, py);
    };
    put(stem, x, y, `${index ? "italic " : ""}${size}px ${font}`);
    pen.textAlign = "left";
    if (index) put(index, x + 0.5, y + size * 0.3, `${size * 0.7}px ${font}`);
  }

  drawMarkers(behind) {
    const { milestones, paint } = this;
    const places = [[milestones.x_c_m, "x_c", paint.vermillion], [milestones.x_r_m, "x_r", paint.green]];
    for (const [point, name, colour] of places) {
      if (!point || this.isBehind(point) !== behind) continue;
      const foot = [point[0], point[1], 0];
      this.stroke([foot, point], colour, 1, [2, 4]);
      this.stroke(ring(foot, 0.1), colour, 1.5);
      this.stroke(ring(point, 0.1), colour, 1.5);
      const [x, y, depth] = this.see(add(point, [0, 0, 0.3]));
      this.stroke([point, add(point, [0, 0, 0.25])], colour, 1);
      if (depth > 0.1) this.text(name, x, y - 4, colour, 16);
    }
    if (!milestones.x_c_m || !milestones.x_r_m || this.isBehind(milestones.x_c_m) !== behind) return;
    const lift = [0, 0, 0.2], tail = add(milestones.x_c_m, lift), tip = add(milestones.x_r_m, lift);
    this.arrow(tail, tip, paint.ink, 1.8);
    const [x, y, depth] = this.see(scaled(add(tail, tip), 0.5));
    if (depth > 0.1) this.text("n_r", x, y - 13, paint.ink, 15);
  }

  /** Rays where the front-left disc meets the obstacle, for a moment after each blow. */
  drawBlow(time, parts) {
    const { flight, milestones, pen } = this, o = milestones.obstacle;
    if (!o) return;
    const last = indexAt(flight.t, time), data = flight.contact_N.data;
    let age = null;
    for (let i = last; i >= 0 && time - flight.t[i] < 0.14; i--) {
      if (data[i] > 0.5) { age = Math.max(0, time - flight.t[i]); break; }
    }
    if (age === null) return;
    let nearest = null, gap = Infinity;
    for (const { kind, points } of parts) {
      if (kind !== "disc" && kind !== "ghost") continue;
      for (const p of points) {
        const d = Math.hypot(p[0] - o.x_m, p[1] - o.y_m) - o.radius_m;
        if (d < gap) { gap = d; nearest = p; }
      }
    }
    if (gap > 0.12) return;
    const [x, y, , s] = this.see(nearest), reach = s * (0.045 + 0.35 * age);
    pen.globalAlpha = 1 - age / 0.15;
    pen.strokeStyle = this.paint.vermillion;
    pen.lineWidth = 2.5;
    pen.beginPath();
    for (let k = 0; k < 9; k++) {
      const c = Math.cos((k * TURN) / 9 + 0.2), d = Math.sin((k * TURN) / 9 + 0.2);
      pen.moveTo(x + 0.45 * reach * c, y + 0.45 * reach * d);
      pen.lineTo(x + reach * c, y + reach * d);
    }
    pen.stroke();
    pen.globalAlpha = 1;
  }

  // -- the vehicle -----------------------------------------------------------------------

  drawParts(parts) {
    const { paint } = this;
    const middle = (points) => scaled(points.reduce(add), 1 / points.length);
    const order = parts.map((part) => ({ part, far: this.see(middle(part.points))[2] - (part.nearer || 0) }));
    order.sort((a, b) => b.far - a.far);
    for (const { part: { kind, points, thickness, rotor, alpha = 1 } } of order) {
      const hit = rotor === FRONT_LEFT, rotorPaint = hit ? paint.vermillion : paint.steel;
      const width = Math.max(1, (thickness || 0) * this.see(points[0])[3]);
      if (kind === "disc") {
        this.fill(points, rotorPaint, 0.3 * alpha);
        this.stroke(points, rotorPaint, Math.min(width, 3), alpha < 0.05 ? [4, 5] : []);
      } else if (kind === "ghost") this.stroke(points, rotorPaint, 1, [3, 3]);
      else if (kind === "blade") {
        this.pen.globalAlpha = 0.75;
        this.stroke(points, rotorPaint, width);
        this.pen.globalAlpha = 1;
      } else if (kind === "thrust") this.arrow(points[0], points[1], hit ? paint.vermillion : paint.teal, 2.2);
      else if (kind === "side") this.fill(points, paint.frame);
      else if (kind === "deck") this.fill(points, paint.deck);
      else if (kind === "nose") this.stroke(points, paint.panel, width);
      else this.stroke(points, kind === "arm" ? (hit ? paint.vermillion : paint.frame) : paint[kind], width);
    }
  }
}
