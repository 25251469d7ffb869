"use strict";
// Time: playing, scrubbing, the keyboard, and everything on the page that follows it.

class Player {
  constructor(flight, milestones) {
    Object.assign(this, { flight, milestones, playing: false, speed: 1, pointed: null });
    this.find = (id) => document.getElementById(id);
    this.scene = new Scene(this.find("scene"), flight, milestones);
    this.charts = new Charts(this.find("charts"), flight, milestones, {
      seek: (time) => this.seek(time),
      hover: (time) => { this.pointed = time; this.ask(); },
    });
    this.time = milestones.mark_s === null ? 0 : Math.min(milestones.mark_s + 0.15, milestones.duration_s);
    this.buildScrub();
    this.wireControls();
    this.wireKeys();
    this.readColours();
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.readColours());
    new ResizeObserver(() => { this.charts.draw(); this.ask(); })
      .observe(document.querySelector(".stage"));
    if (milestones.mark_s !== null) this.aroundMark();
    this.ask();
  }

  readColours() {
    this.scene.readColours();
    this.charts.readColours(this.scene.colour);
    this.ask();
  }

  // -- time ------------------------------------------------------------------------------

  seek(time) {
    this.time = clamp(time, 0, this.milestones.duration_s);
    this.ask();
  }

  play(on) {
    this.playing = on;
    if (on && this.time >= this.milestones.duration_s - 1e-6) this.time = 0;
    this.last = null;
    this.find("play").textContent = on ? "❚❚" : "▶";
    this.find("play").setAttribute("aria-label", on ? "Pause" : "Play");
    this.ask();
  }

  /** Ask for one picture; more follow by themselves while something moves. */
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => {
      this.asked = false;
      this.tick(now / 1000);
    });
  }

  tick(now) {
    const passed = this.last === null || this.last === undefined ? 0.016 : Math.min(now - this.last, 0.1);
    this.last = now;
    if (this.playing) {
      this.time = Math.min(this.time + passed * this.speed, this.milestones.duration_s);
      if (this.time >= this.milestones.duration_s) this.play(false);
    }
    const gliding = this.scene.camera.moving && this.scene.camera.glide(passed);
    this.draw();
    if (this.playing || gliding) this.ask(); else this.last = null;
  }

  /** While paused, pointing at a plot shows the vehicle at that time. */
  draw() {
    const shown = this.playing || this.pointed === null ? this.time : this.pointed;
    this.scene.draw(shown);
    this.charts.cursor(this.time, this.pointed);
    this.find("time").value = String(this.time);
    this.writeClock(shown);
    fillList(this.find("gauges"), gaugeRows(this.flight, shown));
  }

  writeClock(time) {
    const { milestones } = this, mark = milestones.mark_s;
    this.find("clock-time").textContent = `${time.toFixed(2)} s`;
    const name = milestones.contact_s !== null ? "contact" : "crash";
    const after = mark === null ? "" : `${name} ${time < mark ? "−" : "+"}${Math.abs(time - mark).toFixed(2)} s`;
    this.find("clock-contact").textContent = after;
    const phase = Math.round(heldAt(this.flight, "mode", time)[0]), chip = this.find("clock-phase");
    chip.textContent = milestones.phase_names[phase] ?? `phase ${phase}`;
    chip.style.background = milestones.phase_colours[phase] ?? "#c9d1d8";
  }

  // -- controls --------------------------------------------------------------------------

  buildScrub() {
    const { milestones } = this, total = Math.max(milestones.duration_s, 1e-6);
    const place = (time) => `${(100 * clamp(time, 0, total)) / total}%`;
    for (const [start, end, phase] of milestones.phases) {
      const bar = document.createElement("i");
      bar.style.left = place(start);
      bar.style.width = place(end - start);
      bar.style.background = milestones.phase_colours[phase] ?? "#c9d1d8";
      bar.title = milestones.phase_names[phase] ?? `phase ${phase}`;
      this.find("phases").append(bar);
    }
    for (const { time_s, kind, text } of milestones.events) {
      if (time_s === null) continue;
      const tick = document.createElement("button");
      tick.style.left = place(time_s);
      tick.className = kind.replace(/\W/g, "");
      tick.title = `${time_s.toFixed(3)} s: ${kind.replace("_", " ")}${text ? ", " + text : ""}`;
      tick.setAttribute("aria-label", tick.title);
      tick.addEventListener("click", () => this.seek(time_s));
      this.find("events").append(tick);
    }
    this.find("time").max = String(milestones.duration_s);
  }

  aroundMark() {
    const { mark_s, duration_s } = this.milestones;
    this.charts.show(Math.max(0, mark_s - 2), Math.min(duration_s, mark_s + 6));
  }

  jump() {
    if (this.milestones.mark_s === null) return;
    this.seek(this.milestones.mark_s - 0.4);
    this.aroundMark();
  }

  wireControls() {
    const { milestones } = this;
    this.find("play").addEventListener("click", () => this.play(!this.playing));
    this.find("jump").addEventListener("click", () => this.jump());
    this.find("speed").addEventListener("change", (event) => { this.speed = Number(event.target.value); });
    this.find("time").addEventListener("input", (event) => this.seek(Number(event.target.value)));
    this.find("range-mark").addEventListener("click", () => this.aroundMark());
    this.find("range-all").addEventListener("click", () => this.charts.show(0, milestones.duration_s));
    this.charts.changed = () => {
      const whole = this.charts.start === 0 && this.charts.end >= milestones.duration_s;
      this.find("range-all").setAttribute("aria-pressed", String(whole));
    };
    this.charts.changed();
    if (milestones.mark_s === null) {
      for (const id of ["jump", "range-mark", "jump-key"]) this.find(id).hidden = true;
    } else if (milestones.contact_s === null) {
      this.find("jump").textContent = "Jump to the crash";
      this.find("range-mark").textContent = "Around the crash";
    }
    for (const button of document.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => {
        const view = button.dataset.view;
        const { camera } = this.scene;
        if (view === "follow") camera.following = !camera.following; else camera.look(view);
        document.querySelector("[data-view=follow]").setAttribute("aria-pressed", String(camera.following));
        this.ask();
      });
    }
    for (const name of ["pointermove", "wheel"]) this.find("scene").addEventListener(name, () => this.ask());
    for (const button of document.querySelectorAll("[data-seek]")) {
      button.addEventListener("click", () => {
        this.seek(Number(button.dataset.seek));
        document.querySelector(".stage").scrollIntoView({ block: "nearest" });
      });
    }
  }

  wireKeys() {
    document.addEventListener("keydown", (event) => {
      if (this.closed || event.ctrlKey || event.metaKey || event.altKey) return;
      const tag = event.target.tagName, onTime = event.target.id === "time";
      if (["INPUT", "SELECT", "TEXTAREA"].includes(tag) && !onTime) return;
      if (event.key === " " && ["BUTTON", "SUMMARY", "A"].includes(tag)) return;
      const step = event.shiftKey ? 1 : 0.1;
      const acts = {
        " ": () => this.play(!this.playing),
        ArrowLeft: () => this.seek(this.time - step),
        ArrowRight: () => this.seek(this.time + step),
        ",": () => this.seek(this.time - 0.005),
        ".": () => this.seek(this.time + 0.005),
        Home: () => this.seek(0),
        End: () => this.seek(this.milestones.duration_s),
        c: () => this.jump(),
      };
      const act = acts[event.key] || acts[event.key.toLowerCase()];
      if (!act) return;
      event.preventDefault();
      act();
    });
  }
}
