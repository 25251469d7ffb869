"use strict";
// Where the scene is seen from: named views, a glide between them, and pointers that orbit.

/** How much of space there is to see: {target, reach} of the collision and of the whole flight. */
function placesToLook(path, milestones) {
  const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9], pole = milestones.obstacle;
  const include = (p) => p.forEach((x, k) => {
    low[k] = Math.min(low[k], x);
    high[k] = Math.max(high[k], x);
  });
  path.forEach(include);
  if (pole) include([pole.x_m, pole.y_m, Math.min(pole.top_m, high[2] + 0.8)]);
  const middle = scaled(add(low, high), 0.5);
  const whole = { target: middle, reach: 1.15 * Math.max(2, ...sub(high, low)) };
  if (!milestones.x_c_m) return { action: whole, whole };
  const end = milestones.x_r_m || milestones.x_c_m;
  const drop = clamp(milestones.fall_m || 0, 0, 1.2);
  const reach = Math.max(1.5, Math.hypot(...sub(milestones.x_c_m, end)) + 0.6, 1.4 * drop);
  const target = add(scaled(add(milestones.x_c_m, end), 0.5), [0.1, 0, -drop / 2.2]);
  return { action: { target, reach }, whole };
}

class Camera {
  /** @param canvas whose pointers orbit, zoom and pan @param path points [x, y, z] of the flight */
  constructor(canvas, path, milestones) {
    Object.assign(this, { canvas, places: placesToLook(path, milestones), following: false });
    this.look("action");
    this.now = { ...this.goal };
    this.listen();
  }

  /** Head for a named view. */
  look(view) {
    const { action, whole } = this.places;
    const angles = { action: [-1.22, 0.24], side: [-Math.PI / 2, 0.03], top: [-Math.PI / 2, 1.45], whole: [-1.22, 0.3] };
    if (view === "whole") this.following = false;
    const { target, reach } = view === "whole" ? whole : action, [yaw, pitch] = angles[view];
    this.goal = { yaw, pitch, distance: 1.42 * reach, target: this.following ? this.now.target : target };
    this.moving = true;
  }

  /** Keep the vehicle in the middle, if the reader wants it so. */
  follow(position) {
    if (this.following) this.goal.target = this.now.target = position;
  }

  /** Ease towards the goal; returns whether there is still way to go. */
  glide(seconds) {
    const share = 1 - Math.exp(-9 * seconds), { now, goal } = this;
    let left = Math.hypot(...sub(goal.target, now.target));
    for (const key of ["yaw", "pitch", "distance"]) {
      left += Math.abs(goal[key] - now[key]);
      now[key] += (goal[key] - now[key]) * share;
    }
    now.target = add(now.target, scaled(sub(goal.target, now.target), share));
    this.moving = left > 1e-3;
    if (!this.moving) this.now = { ...goal };
    return this.moving;
  }

  get axes() {
    const { yaw, pitch, distance, target } = this.now, flat = Math.cos(pitch);
    const back = [flat * Math.cos(yaw), flat * Math.sin(yaw), Math.sin(pitch)];
    const forward = scaled(back, -1), right = [-Math.sin(yaw), Math.cos(yaw), 0];
    return { eye: add(target, scaled(back, distance)), forward, right, up: cross(right, forward) };
  }

  /** Function from a point in the map to [x, y, depth, pixels per metre] on a canvas this large. */
  projection(width, height) {
    const { eye, forward, right, up } = this.axes, focal = 0.86 * Math.min(width, 1.25 * height);
    return (p) => {
      const r = sub(p, eye), depth = dot(r, forward), s = focal / Math.max(depth, 0.05);
      return [width / 2 + dot(r, right) * s, height / 2 - dot(r, up) * s, depth, s];
    };
  }

  listen() {
    const { canvas } = this, held = new Map();
    const change = (act) => { act(this.goal); this.now = { ...this.goal }; this.moving = true; };
    const zoom = (factor) => change((goal) => { goal.distance = clamp(goal.distance * factor, 0.5, 40); });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, (event) => held.delete(event.pointerId));
    }
    canvas.addEventListener("pointermove", (event) => {
      const last = held.get(event.pointerId), now = [event.clientX, event.clientY];
      if (!last) return;
      held.set(event.pointerId, now);
      const dx = now[0] - last[0], dy = now[1] - last[1];
      const other = [...held].find(([id]) => id !== event.pointerId);
      if (other) {
        const span = (p) => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]) || 1;
        zoom(span(last) / span(now));
      } else if (event.shiftKey || event.buttons === 2) {
        const { right, up } = this.axes, step = this.goal.distance / canvas.clientHeight;
        change((goal) => { goal.target = add(goal.target, add(scaled(right, -dx * step), scaled(up, dy * step))); });
      } else {
        change((goal) => {
          goal.yaw -= dx * 0.008;
          goal.pitch = clamp(goal.pitch + dy * 0.006, -0.02, 1.55);
        });
      }
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(Math.exp(event.deltaY * 0.0012));
    }, { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }
}
