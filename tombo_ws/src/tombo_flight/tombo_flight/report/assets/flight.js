"use strict";
// The flight as data: decoding, looking up by time, and the little algebra that pictures need.

/** Decode {samples, columns: [[name, width]...], base64 of little-endian float32} into
 *  {count, t, <name>: {width, data}}; data holds (count, width) rows. */
function decodeFlight(block) {
  const bytes = Uint8Array.from(atob(block.base64), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  const flight = { count: block.samples };
  let at = 0;
  for (const [name, width] of block.columns) {
    const data = new Float32Array(block.samples * width);
    for (let i = 0; i < data.length; i++, at += 4) data[i] = view.getFloat32(at, true);
    flight[name] = { width, data };
  }
  flight.t = flight.t.data;
  return flight;
}

/** Index of the last sample at or before `time`; 0 before the first. */
function indexAt(t, time) {
  let low = 0, high = t.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (t[middle] <= time) low = middle; else high = middle - 1;
  }
  return low;
}

/** One row of a column at `time`, interpolated between samples. */
function rowAt(flight, name, time) {
  const { width, data } = flight[name];
  const i = indexAt(flight.t, time), j = Math.min(i + 1, flight.count - 1);
  const gap = flight.t[j] - flight.t[i];
  const u = gap > 0 ? clamp((time - flight.t[i]) / gap, 0, 1) : 0;
  return Array.from({ length: width }, (_, k) => data[i * width + k] * (1 - u) + data[j * width + k] * u);
}

/** A row as it is at the last sample, for values that have no in-between. */
function heldAt(flight, name, time) {
  const { width, data } = flight[name], i = indexAt(flight.t, time);
  return Array.from(data.subarray(i * width, (i + 1) * width));
}

/** Attitude at `time` as a unit quaternion xyzw (map <- base_link). */
function attitudeAt(flight, time) {
  const i = indexAt(flight.t, time), j = Math.min(i + 1, flight.count - 1), d = flight.attitude.data;
  const gap = flight.t[j] - flight.t[i];
  const u = gap > 0 ? clamp((time - flight.t[i]) / gap, 0, 1) : 0;
  let dot = 0;
  for (let k = 0; k < 4; k++) dot += d[4 * i + k] * d[4 * j + k];
  const q = [0, 1, 2, 3].map((k) => d[4 * i + k] * (1 - u) + Math.sign(dot || 1) * d[4 * j + k] * u);
  const size = Math.hypot(...q) || 1;
  return q.map((x) => x / size);
}

/** Function that turns a base_link vector into the map frame. */
function turner([x, y, z, w]) {
  const m = [
    1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
    2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
    2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
  ];
  return (v) => [
    m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
    m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
    m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
  ];
}

/** Roll, pitch, yaw in degrees of a quaternion xyzw. */
function rollPitchYaw([x, y, z, w]) {
  const degrees = 180 / Math.PI;
  return [
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) * degrees,
    Math.asin(clamp(2 * (w * y - z * x), -1, 1)) * degrees,
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) * degrees,
  ];
}

/** Angle between the vehicle's up axis and the vertical, degrees. */
function tiltOf([x, y]) {
  return (2 * Math.asin(clamp(Math.hypot(x, y), 0, 1)) * 180) / Math.PI;
}

/** What the gauges show at `time`: rows [name, value with unit]. */
function gaugeRows(flight, time) {
  const at = (name) => rowAt(flight, name, time);
  return [
    ["height", `${at("position")[2].toFixed(2)} m`],
    ["speed", `${Math.hypot(...at("velocity")).toFixed(2)} m/s`],
    ["tilt", `${tiltOf(attitudeAt(flight, time)).toFixed(1)} °`],
    ["front-left thrust", `${at("rotor_thrust")[2].toFixed(2)} N`],
    ["front-left speed", `${((at("rotor_speed")[2] * 30) / Math.PI).toFixed(0)} rpm`],
    ["front-left fold", `${(100 * at("fold")[2]).toFixed(0)} %`],
  ];
}

/** Fill a definition list with rows [name, text, style?], without making it anew. */
function fillList(node, rows) {
  const missing = rows.length - node.children.length / 2;
  for (let k = 0; k < missing; k++) {
    node.append(document.createElement("dt"), document.createElement("dd"));
  }
  for (let k = 0; k < -2 * missing; k++) node.lastChild.remove();
  const names = node.querySelectorAll("dt"), texts = node.querySelectorAll("dd");
  rows.forEach(([name, text, style = ""], i) => {
    if (names[i].textContent !== name) names[i].textContent = name;
    if (texts[i].textContent !== text) texts[i].textContent = text;
    texts[i].className = style;
  });
}

const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
