"use strict";
// The vehicle in space, drawn on a plain canvas: far things first, near things last.

const TURN = 2 * Math.PI;
const THRUST_M_PER_N = 0.05;
const TRAIL_STEP_M = 0.012;

class Scene {
  /** @param canvas where to draw @param flight decoded columns @param story what happened */
  constructor(canvas, flight, story) {
    Object.assign(this, { canvas, flight, story, following: false, moving: true });
    this.pen = canvas.getContext("2d");
    this.trail = this.thinTrail();
    this.look("action", true);
    this.handlePointers();
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

  // -- camera ----------------------------------------------------------------------------

  /** Go to a named view; `at once` skips the glide. */
  look(view, atOnce = false) {
    const { story } = this, low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
    for (const { p } of this.trail) {
      for (let k = 0; k < 3; k++) { low[k] = Math.min(low[k], p[k]); high[k] = Math.max(high[k], p[k]); }
    }
    const o = story.obstacle;
    if (o) { low[2] = Math.min(low[2], 0); high[0] = Math.max(high[0], o.x_m); high[2] = Math.max(high[2], Math.min(o.top_m, high[2] + 0.8)); }
    const whole = { target: scaled(add(low, high), 0.5), reach: Math.max(2, ...sub(high, low)) * 1.15 };
    let action = whole;
    if (story.x_c_m) {
      const other = story.x_r_m || story.x_c_m, drop = (story.contact_height_m - story.lowest_m) || 0;
      action = {
        target: sub(scaled(add(story.x_c_m, other), 0.5), [-0.1, 0, Math.min(drop, 1) / 2.2]),
        reach: Math.max(1.5, Math.hypot(...sub(story.x_c_m, other)) + 0.6, 1.4 * Math.min(drop, 1.2)),
      };
    }
    const around = this.following && view !== "whole" ? { ...action, target: null } : action;
    const goals = {
      action: { ...around, yaw: -1.22, pitch: 0.24 },
      side: { ...around, yaw: -Math.PI / 2, pitch: 0.03 },
      top: { ...around, yaw: -Math.PI / 2, pitch: 1.45 },
      whole: { ...whole, yaw: -1.22, pitch: 0.3 },
    };
    const goal = goals[view];
    this.goal = { yaw: goal.yaw, pitch: goal.pitch, distance: goal.reach * 1.42,
      target: goal.target || this.camera.target };
    if (view === "whole") this.following = false;
    if (atOnce) this.camera = { ...this.goal };
    this.moving = true;
  }

  /** Ease the camera towards where it is wanted; returns whether it still moves. */
  glide(seconds) {
    const share = 1 - Math.exp(-9 * seconds), camera = this.camera, goal = this.goal;
    let left = 0;
    for (const key of ["yaw", "pitch", "distance"]) {
      camera[key] += (goal[key] - camera[key]) * share;
      left += Math.abs(goal[key] - camera[key]);
    }
    camera.target = camera.target.map((x, k) => x + (goal.target[k] - x) * share);
    left += Math.hypot(...sub(goal.target, camera.target));
    if (left < 1e-3) this.camera = { ...goal };
    return (this.moving = left >= 1e-3);
  }

  handlePointers() {
    const { canvas } = this, held = new Map();
    const nudge = (change) => { change(this.goal); this.camera = { ...this.goal }; this.moving = true; };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, (event) => held.delete(event.pointerId));
    }
    canvas.addEventListener("pointermove", (event) => {
      const last = held.get(event.pointerId);
      if (!last) return;
      const now = [event.clientX, event.clientY], dx = now[0] - last[0], dy = now[1] - last[1];
      const others = [...held].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      held.set(event.pointerId, now);
      nudge((goal) => {
        if (others.length) {
          const span = (p) => Math.hypot(p[0] - others[0][0], p[1] - others[0][1]) || 1;
          goal.distance = clamp((goal.distance * span(last)) / span(now), 0.5, 40);
        } else if (event.shiftKey || event.buttons === 2) {
          const { right, up } = this.basis(), step = goal.distance / canvas.clientHeight;
          goal.target = add(goal.target, add(scaled(right, -dx * step), scaled(up, dy * step)));
        } else {
          goal.yaw -= dx * 0.008;
          goal.pitch = clamp(goal.pitch + dy * 0.006, -0.02, 1.55);
        }
      });
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      nudge((goal) => { goal.distance = clamp(goal.distance * Math.exp(event.deltaY * 0.0012), 0.5, 40); });
    }, { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  basis() {
    const { yaw, pitch, distance, target } = this.camera;
    const back = [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)];
    const forward = scaled(back, -1), right = [-Math.sin(yaw), Math.cos(yaw), 0];
    return { eye: add(target, scaled(back, distance)), forward, right, up: cross(right, forward) };
  }

  // -- one picture -----------------------------------------------------------------------

  /** Draw the flight at `time` [s]. */
  draw(time) {
    const { canvas, pen, flight } = this, sharp = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * sharp) || canvas.height !== Math.round(height * sharp)) {
      canvas.width = Math.round(width * sharp);
      canvas.height = Math.round(height * sharp);
    }
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    pen.lineCap = pen.lineJoin = "round";
    const position = rowAt(flight, "position", time);
    if (this.following) { this.goal.target = position; this.camera.target = position; }
    const { eye, forward, right, up } = this.basis();
    const focal = 1.72 * Math.min(width, height * 1.25) * 0.5;
    this.eye = eye;
    this.see = (p) => {
      const r = sub(p, eye), depth = dot(r, forward), s = focal / Math.max(depth, 0.05);
      return [width / 2 + dot(r, right) * s, height / 2 - dot(r, up) * s, depth, s];
    };

    const sky = pen.createLinearGradient(0, 0, 0, height);
    sky.addColorStop(0, this.paint["sky-top"]);
    sky.addColorStop(1, this.paint["sky-low"]);
    pen.fillStyle = sky;
    pen.fillRect(0, 0, width, height);

    const parts = this.vehicle(time, position);
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
    const o = this.story.obstacle;
    if (!o) return false;
    const far = (x, y) => Math.hypot(x - this.eye[0], y - this.eye[1]);
    return far(p[0], p[1]) > far(o.x_m, o.y_m);
  }

  drawGround() {
    const { pen } = this, [cx, cy] = this.camera.target.map(Math.round), reach = 9;
    const faint = Array.from({ length: 5 }, () => new Path2D());
    for (let k = -reach; k <= reach; k += 0.5) {
      for (let a = -reach; a < reach; a += 1) {
        const fade = 1 - Math.hypot(k, a + 0.5) / reach;
        if (fade <= 0) continue;
        for (const [p, q] of [[[cx + k, cy + a, 0], [cx + k, cy + a + 1, 0]], [[cx + a, cy + k, 0], [cx + a + 1, cy + k, 0]]]) {
          const s = this.see(p), e = this.see(q);
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
    const o = this.story.obstacle;
    if (!o) return;
    const sides = 40, ring = (z) => (k) => [
      o.x_m + o.radius_m * Math.cos((k * TURN) / sides), o.y_m + o.radius_m * Math.sin((k * TURN) / sides), z,
    ];
    const foot = ring(0), head = ring(o.top_m), light = unit([-0.5, -0.75, 0]);
    // The visible half as one shape, shaded from silhouette to silhouette.
    const away = Math.atan2(this.eye[1] - o.y_m, this.eye[0] - o.x_m);
    const far = Math.hypot(this.eye[0] - o.x_m, this.eye[1] - o.y_m);
    const half = far > o.radius_m ? Math.acos(o.radius_m / far) : 0;
    const turns = Array.from({ length: 17 }, (_, k) => (sides * (away + half * (k / 8 - 1))) / TURN);
    const level = clamp(this.camera.target[2], 0, o.top_m);
    const ends = [turns[0], turns[16]].map((k) => this.see(ring(level)(k)));
    if (ends.every((end) => end[2] > 0.06)) {
      const glow = this.pen.createLinearGradient(ends[0][0], ends[0][1], ends[1][0], ends[1][1]);
      const flat = ends.map(([x, y]) => [x, y]), across = sub([...flat[1], 0], [...flat[0], 0]);
      for (const k of turns) {
        const angle = (k * TURN) / sides, p = this.see(ring(level)(k));
        const bright = 0.72 + 0.45 * Math.max(0, dot([Math.cos(angle), Math.sin(angle), 0], light));
        const at = dot(sub([p[0], p[1], 0], [...flat[0], 0]), across) / (dot(across, across) || 1);
        glow.addColorStop(clamp(at, 0, 1), `rgb(${this.paint.pole.split(" ").map((c) => Math.min(255, c * bright)).join(" ")})`);
      }
      this.fill([...turns.map(foot), ...turns.map(head).reverse()], glow);
    }
    const cap = Array.from({ length: sides }, (_, k) => head(k));
    if (this.eye[2] > o.top_m) this.fill(cap, `rgb(${this.paint.pole})`);
  }

  // -- the path --------------------------------------------------------------------------

  thinTrail() {
    const { flight, story } = this, { data } = flight.position, trail = [];
    const marks = [story.contact_s, story.unstable_end_s, story.recovery_end_s].filter((t) => t !== null);
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
    const { paint, trail } = this, crashed = this.story.verdict === "crashed";
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

  ring(centre, radius) {
    return Array.from({ length: 49 }, (_, k) => add(centre, [
      radius * Math.cos((k * TURN) / 48), radius * Math.sin((k * TURN) / 48), 0,
    ]));
  }

  drawMarkers(behind) {
    const { story, paint } = this;
    for (const [point, name, colour] of [[story.x_c_m, "x_c", paint.vermillion], [story.x_r_m, "x_r", paint.green]]) {
      if (!point || this.isBehind(point) !== behind) continue;
      const foot = [point[0], point[1], 0];
      this.stroke([foot, point], colour, 1, [2, 4]);
      this.stroke(this.ring(foot, 0.1), colour, 1.5);
      this.stroke(this.ring(point, 0.1), colour, 1.5);
      const [x, y, depth] = this.see(add(point, [0, 0, 0.3]));
      this.stroke([point, add(point, [0, 0, 0.25])], colour, 1);
      if (depth > 0.1) this.text(name, x, y - 4, colour, 16);
    }
    if (!story.x_c_m || !story.x_r_m || this.isBehind(story.x_c_m) !== behind) return;
    const lift = [0, 0, 0.2], tail = add(story.x_c_m, lift), tip = add(story.x_r_m, lift);
    this.arrow(tail, tip, paint.ink, 1.8);
    const [x, y, depth] = this.see(scaled(add(tail, tip), 0.5));
    if (depth > 0.1) this.text("n_r", x, y - 13, paint.ink, 15);
  }

  /** Rays where the front-left disc meets the obstacle, for a moment after each blow. */
  drawBlow(time, parts) {
    const { flight, story, pen } = this, o = story.obstacle;
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

  /** Pieces of the vehicle in the map frame: {kind, points, thickness [m], rotor, alpha, nearer}. */
  vehicle(time, position) {
    const { flight, story } = this, shape = story.shape, turn = turner(attitudeAt(flight, time));
    const put = (points) => points.map((p) => add(position, turn(p)));
    const fold = rowAt(flight, "fold", time), damage = rowAt(flight, "damage", time);
    const speed = rowAt(flight, "rotor_speed", time), thrust = rowAt(flight, "rotor_thrust", time);
    const parts = [];
    for (const y of [-0.11, 0.11]) {
      parts.push({ kind: "leg", points: put([[0, y / 2, 0], [0, y, -shape.leg_m]]), thickness: 0.01 });
      parts.push({ kind: "leg", points: put([[-0.12, y, -shape.leg_m], [0.13, y, -shape.leg_m]]), thickness: 0.012 });
    }
    shape.rotors_m.forEach(([x, y, z], rotor) => {
      const hub = [x, y, z], wing = shape.disc_m - shape.nodus_m;
      parts.push({ kind: "arm", points: put([[0.2 * x, 0.2 * y, 0], [x, y, 0]]), thickness: 0.02, rotor });
      parts.push({ kind: "motor", points: put([[x, y, -0.004], [x, y, z - 0.006]]), thickness: 0.028 });
      // A stiff wing hinged at the nodus: the tip draws in linearly, as in the simulation.
      const tipAt = (folded) => {
        const stretched = 1 - clamp(folded, 0, 1);
        return [shape.nodus_m + wing * stretched, -wing * Math.sqrt(1 - stretched * stretched)];
      };
      const rim = ([radius, sink]) => this.ring([x, y, z + sink], radius);
      const tip = tipAt(fold[rotor]), whole = 1 - clamp(damage[rotor], 0, 1);
      if (fold[rotor] > 0.02) parts.push({ kind: "ghost", points: put(rim(tipAt(0))), rotor });
      parts.push({ kind: "disc", points: put(rim(tip)), thickness: 0.006, rotor, alpha: whole, nearer: 0.02 });
      const spin = speed[rotor] > 20 ? (rotor < 2 ? 40 : -40) * time : 0;
      for (const half of [0, Math.PI]) {
        const along = [Math.cos(spin + half), Math.sin(spin + half), 0];
        const end = add(scaled(along, tip[0]), [0, 0, tip[1]]);
        const blade = [hub, add(hub, scaled(along, shape.nodus_m)), add(hub, end)];
        if (whole > 0.05) parts.push({ kind: "blade", points: put(blade), thickness: 0.011, rotor, nearer: 0.02 });
      }
      if (thrust[rotor] > 0.05) {
        const head = add(hub, [0, 0, THRUST_M_PER_N * thrust[rotor]]);
        parts.push({ kind: "thrust", points: put([hub, head]), rotor, nearer: 0.03 });
      }
    });
    const octagon = (z) => Array.from({ length: 9 }, (_, k) => [
      0.07 * Math.cos((k * TURN) / 8), 0.07 * Math.sin((k * TURN) / 8), z,
    ]);
    const low = put(octagon(-0.02)), top = put(octagon(0.022));
    for (let k = 0; k < 8; k++) parts.push({ kind: "side", points: [low[k], low[k + 1], top[k + 1], top[k]] });
    const upward = dot(sub(this.eye, position), turn([0, 0, 1])) > 0;
    parts.push({ kind: "deck", points: upward ? top : low, nearer: 0.03 });
    if (upward) parts.push({ kind: "nose", points: put([[0.02, 0, 0.024], [0.058, 0, 0.024]]), thickness: 0.014, nearer: 0.04 });
    return parts;
  }

  drawParts(parts) {
    const { paint } = this;
    const depth = ({ points, nearer = 0 }) => this.see(points.reduce((sum, p) => add(sum, scaled(p, 1 / points.length)), [0, 0, 0]))[2] - nearer;
    const order = parts.map((part) => ({ part, far: depth(part) })).sort((a, b) => b.far - a.far);
    for (const { part: { kind, points, thickness, rotor, alpha = 1 } } of order) {
      const hit = rotor === 2, rotorPaint = hit ? paint.vermillion : paint.steel;
      const width = Math.max(1, (thickness || 0) * this.see(points[0])[3]);
      if (kind === "disc") {
        this.fill(points, rotorPaint, 0.3 * alpha);
        this.stroke(points, rotorPaint, Math.min(width, 3), alpha < 0.95 ? [4, 5] : []);
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
