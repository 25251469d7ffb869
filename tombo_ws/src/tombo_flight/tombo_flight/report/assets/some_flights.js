"use strict";
// A page with some flights, of which one is shown: a button with data-flight="N" shows the N-th.

const readBlock = (id) => JSON.parse(document.getElementById(id).textContent);
const emptyStage = document.querySelector(".stage").cloneNode(true);
let player = null;

/** Show a flight in place of the one before. */
function showFlight(number) {
  if (player) {
    player.close();
    document.querySelector(".stage").replaceWith(emptyStage.cloneNode(true));
  }
  player = new Player(decodeFlight(readBlock(`flight-${number}`)), readBlock(`milestones-${number}`));
  for (const button of document.querySelectorAll("[data-flight]")) {
    button.setAttribute("aria-pressed", String(button.dataset.flight === String(number)));
  }
}

for (const button of document.querySelectorAll("[data-flight]")) {
  button.addEventListener("click", () => showFlight(button.dataset.flight));
}
showFlight(0);
document.documentElement.dataset.ready = "yes";
