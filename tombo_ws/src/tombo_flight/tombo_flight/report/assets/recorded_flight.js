"use strict";
// A page with one flight, which is shown at once.

const readBlock = (id) => JSON.parse(document.getElementById(id).textContent);
const player = new Player(decodeFlight(readBlock("flight")), readBlock("milestones"));
document.documentElement.dataset.ready = "yes";
