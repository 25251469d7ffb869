"use strict";
// The pieces of the vehicle at an instant, in the map frame.

const TURN = 2 * Math.PI;
const THRUST_M_PER_N = 0.05;

/** A closed horizontal circle of 49 points. */
function ring(centre, radius) {
  return Array.from({ length: 49 }, (_, k) => add(centre, [
    radius * Math.cos((k * TURN) / 48), radius * Math.sin((k * TURN) / 48), 0,
  ]));
}

/** Pieces {kind, points, thickness [m], rotor, alpha, nearer}; `nearer` [m] moves a piece towards
 *  the eye when pieces are put in order. `eye` decides which side of the deck is seen. */
function vehicleParts(flight, shape, time, eye) {
  const position = rowAt(flight, "position", time), turn = turner(attitudeAt(flight, time));
  const put = (points) => points.map((p) => add(position, turn(p)));
  const [fold, damage, speed, thrust] = ["fold", "damage", "rotor_speed", "rotor_thrust"]
    .map((name) => rowAt(flight, name, time));
  const parts = [], low = -shape.leg_m;
  for (const y of [-0.11, 0.11]) {
    parts.push({ kind: "leg", points: put([[0, y / 2, 0], [0, y, low]]), thickness: 0.01 });
    parts.push({ kind: "leg", points: put([[-0.12, y, low], [0.13, y, low]]), thickness: 0.012 });
  }
  shape.rotors_m.forEach(([x, y, z], rotor) => {
    const hub = [x, y, z], whole = 1 - clamp(damage[rotor], 0, 1), wing = shape.disc_m - shape.nodus_m;
    // A stiff wing turns backwards about the nodus, in the plane of the disc; its tip has the
    // reach of the simulation.
    const reachAt = (folded) => shape.nodus_m + wing * (1 - clamp(folded, 0, 1));
    const rim = (radius) => put(ring(hub, radius)), reach = reachAt(fold[rotor]);
    const bend = Math.acos(clamp((reach ** 2 - shape.nodus_m ** 2 - wing ** 2) / (2 * shape.nodus_m * wing), -1, 1));
    parts.push({ kind: "arm", points: put([[0.2 * x, 0.2 * y, 0], [x, y, 0]]), thickness: 0.02, rotor });
    parts.push({ kind: "motor", points: put([[x, y, -0.004], [x, y, z - 0.006]]), thickness: 0.028 });
    if (fold[rotor] > 0.02) parts.push({ kind: "ghost", points: rim(reachAt(0)), rotor });
    parts.push({ kind: "disc", points: rim(reach), thickness: 0.006, rotor, alpha: whole, nearer: 0.02 });
    // Blades turn slowly enough to be seen, the way the real ones turn.
    const way = rotor < 2 ? 1 : -1, spin = speed[rotor] > 20 ? way * 40 * time : 0;
    const along = (angle) => [Math.cos(angle), Math.sin(angle), 0];
    for (const angle of whole > 0.05 ? [spin, spin + Math.PI] : []) {
      const nodus = add(hub, scaled(along(angle), shape.nodus_m));
      const points = put([hub, nodus, add(nodus, scaled(along(angle - way * bend), wing))]);
      parts.push({ kind: "blade", points, thickness: 0.011, rotor, nearer: 0.02 });
    }
    if (thrust[rotor] > 0.05) {
      const points = put([hub, add(hub, [0, 0, THRUST_M_PER_N * thrust[rotor]])]);
      parts.push({ kind: "thrust", points, rotor, nearer: 0.03 });
    }
  });
  const octagon = (z) => put(Array.from({ length: 9 }, (_, k) => [
    0.07 * Math.cos((k * TURN) / 8), 0.07 * Math.sin((k * TURN) / 8), z,
  ]));
  const bottom = octagon(-0.02), top = octagon(0.022);
  const fromAbove = dot(sub(eye, position), turn([0, 0, 1])) > 0;
  for (let k = 0; k < 8; k++) parts.push({ kind: "side", points: [bottom[k], bottom[k + 1], top[k + 1], top[k]] });
  parts.push({ kind: "deck", points: fromAbove ? top : bottom, nearer: 0.03 });
  if (fromAbove) {
    parts.push({ kind: "nose", points: put([[0.02, 0, 0.024], [0.058, 0, 0.024]]), thickness: 0.014, nearer: 0.04 });
  }
  return parts;
}
