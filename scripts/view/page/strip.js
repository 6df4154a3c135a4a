// The strip of states at the top; grey when the last frame is old.
import { put } from "./words.js";

const $ = (id) => document.getElementById(id);
const OLD = 1.0; // seconds
const FIT = $("fit").title;

export class Strip {
  constructor(page) {
    this.page = page;
    this.lost = false;
    this.chip = null;
  }

  source(hello) {
    $("source").textContent = hello.live ? "live" : "recording";
    $("source").parentElement.title = hello.source;
    $("chip").hidden = !hello.live;
  }

  set(id, text, kind = "", small = null) {
    const cell = $(id);
    const words = cell.querySelector("b");
    put(words, text);
    for (const name of ["good", "warn", "bad"]) cell.classList.toggle(name, name === kind);
    if (small !== null) put(cell.querySelector("span"), small);
  }

  show(frame) {
    const strip = frame.strip;
    this.frame = frame;
    this.set("rate", strip.rate.toFixed(1));
    this.set("ok", `${strip.ok}/${strip.beams}`, strip.ok < strip.beams / 2 ? "warn" : "");
    this.set("doubtful", String(strip.doubtful), strip.doubtful > strip.beams / 10 ? "warn" : "");
    this.set("noise", strip.noise.toFixed(1));
    this.set("lost", String(strip.lost), strip.lost ? "warn" : "");
    const fit = strip.fit;
    this.set("fit", fit === null ? "-" : fit.toFixed(2),
      strip.moved ? "bad" : fit !== null && fit > strip.fit_normal ? "warn" : "",
      strip.moved ? "rig has moved" : "fit, px");
    $("fit").title = strip.moved || FIT;
    this.laser();
  }

  laser() {
    const strip = this.frame ? this.frame.strip : null;
    const chip = this.chip;
    let kind = "", text = "-", small = "laser";
    if (chip && chip.causes.length || strip && strip.tripped) {
      [kind, text] = ["bad", "tripped"];
      small = chip && chip.causes.length ? chip.causes.join(", ") : "laser guard";
    } else if (chip && chip.mode === "stop") [text, small] = ["off", "stopped"];
    else if (chip && !chip.armed) {
      [kind, text] = ["warn", "off"];
      small = chip.tables ? "waits for frames" : "no calibration loaded";
    } else if (strip && strip.summarised) {
      if (strip.lit) [kind, text, small] = ["good", "lit", strip.capture ? "calibration capture" : "laser"];
      else [kind, text, small] = ["warn", "off", strip.tables ? "laser" : "no calibration loaded"];
      if (strip.verified === false) [kind, small] = ["bad", "other calibration"];
    }
    this.set("laser", text, kind, small);
    $("laser").title = chip ? `The infrared laser: ${chip.laser}` : "The infrared laser";
  }

  texture(head) {
    this.set("texture", head.age === null ? "-" : `${head.age.toFixed(1)} s`);
    $("texture").title = `${Math.round(100 * head.part)} % of the picture has come`;
  }

  state(state) {
    this.chip = state.chip;
    const recording = state.recording || { on: false, where: "" };
    const name = recording.where.split("/").slice(-2).join("/");
    if (!this.page.live) this.set("recording", name || "-", "", state.reading ? "being read" : "replay");
    else this.set("recording", name, recording.on ? "good" : "bad",
      recording.on ? "recording to" : "not recording");
    $("recording").title = recording.where;
    this.laser();
  }

  tick() {
    const age = (performance.now() - this.page.received) / 1000;
    const stale = this.lost ||
      this.page.live && this.page.following && this.page.frame !== null && age > OLD;
    $("strip").classList.toggle("stale", stale);
    $("stage").classList.toggle("old", stale);
    if (stale && this.page.frame) {
      this.set("rate", "0.0");
      const text = this.lost ? "not connected" : `no frame for ${Math.floor(age)} s`;
      put($("laser").querySelector("b"), text);
    }
  }
}
