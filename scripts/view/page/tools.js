// Ruler and polyp tool, the list of measurements, and the capsule's controls.
import { put } from "./words.js";

const $ = (id) => document.getElementById(id);
const DRAGGED = 6; // pixels of the screen
const CIRCLE = 24; // points
const HINTS = {
  none: "Choose the ruler or the polyp tool.",
  ruler: ["Click the first point, on the surface or in the picture.", "Click the second point."],
  polyp: ["Mark the polyp\u2019s rim where it is widest: three points or more, or drag a circle in the picture.",
    "Go on around the rim.", "Go on around the rim, then press \u201cMeasure\u201d."],
};

// The capsule's modes: their buttons, and in words.
const BUTTONS = { stop: "stop", continuous: "start", single: "single", pattern: "pattern-only", images: "pattern-images" };
const MODES = { stop: "stopped", continuous: "running", single: "one pair", pattern: "points only", images: "sends images" };

// A length with its uncertainty, with a second digit where that is small.
function spread(value, uncertainty) {
  const digits = uncertainty < 0.095 ? 2 : 1;
  return `${value.toFixed(digits)} \u00b1 ${uncertainty.toFixed(digits)} mm`;
}

export class Tools {
  constructor(page) {
    this.page = page;
    this.tool = null;
    this.marks = [];
    this.found = [];
    this.busy = this.opened = false;
    document.querySelectorAll("[data-tool]").forEach((button) => {
      button.onclick = () => this.choose(this.tool === button.dataset.tool ? null : button.dataset.tool);
    });
    document.querySelectorAll("[data-chip]").forEach((button) => {
      button.onclick = () => this.command(button.dataset.chip);
    });
    $("done").onclick = () => this.finish();
    $("chip").ontoggle = () => { if ($("chip").open) $("chip").scrollIntoView({ block: "nearest" }); };
    $("registers").onsubmit = (event) => { event.preventDefault(); this.write(); };
    this.pointer($("view"), (event) => page.stage.pick(event), false);
    this.pointer($("picture"), (event) => page.picture.at(event), true);
  }

  // A click marks a point, a drag in the picture a circle; a drag over the scene turns it.
  pointer(canvas, place, draws) {
    let begin = null;
    canvas.addEventListener("pointerdown", (event) => {
      begin = event.button === 0 ? [event.clientX, event.clientY, place(event)] : null;
      if (draws && this.tool === "polyp") canvas.setPointerCapture(event.pointerId);
    });
    const circle = (event) => {
      const [u, v] = begin[2], end = place(event);
      return [u, v, Math.hypot(end[0] - u, end[1] - v)];
    };
    const dragged = (event) =>
      Math.hypot(event.clientX - begin[0], event.clientY - begin[1]) > DRAGGED;
    canvas.addEventListener("pointermove", (event) => {
      if (begin && draws && this.tool === "polyp" && dragged(event)) this.draw(circle(event));
    });
    canvas.addEventListener("pointerup", (event) => {
      if (!begin || !this.tool || !this.page.frame) { begin = null; return; }
      if (!dragged(event)) this.mark(begin[2]);
      else if (draws && this.tool === "polyp") {
        const [u, v, radius] = circle(event);
        this.marks = Array.from({ length: CIRCLE }, (_, index) => {
          const angle = 2 * Math.PI * index / CIRCLE;
          return [u + radius * Math.cos(angle), v + radius * Math.sin(angle)];
        });
        this.finish();
      }
      begin = null;
    });
    canvas.addEventListener("pointercancel", () => { begin = null; });
  }

  choose(tool) {
    this.tool = tool;
    this.marks = [];
    document.body.classList.toggle("tooled", tool !== null);
    document.querySelectorAll("[data-tool]").forEach(
      (button) => button.classList.toggle("on", button.dataset.tool === tool));
    // What is measured stands still.
    if (tool) this.page.freeze();
    this.draw();
  }

  mark(place) {
    if (!place) {
      this.page.say("There is no surface: click where it is.");
      return;
    }
    this.marks.push(place);
    if (this.tool === "ruler" && this.marks.length === 2) this.finish();
    else this.draw();
  }

  finish() {
    const least = this.tool === "polyp" ? 3 : 2;
    if (!this.tool || this.busy || this.marks.length < least || !this.page.frame) return;
    this.busy = true;
    const points = this.marks;
    this.page.ask({
      do: "measure", kind: this.tool, points, position: this.page.frame.position,
      frames: Number($("mean").value) || 1,
    }).then((found) => {
      const notes = found.notes.length ? ` (${found.notes.join("; ")})` : "";
      this.page.say(`${this.words(found)}${notes}.`);
    }, (error) => this.page.say(error.message)).finally(() => {
      this.busy = false;
      this.marks = [];
      this.draw();
    });
  }

  words(found) {
    const length = spread(found.length_mm, found.uncertainty_mm);
    if (found.kind === "ruler") return length;
    const height = found.height_mm === null ? "height not known"
      : `height ${found.height_mm.toFixed(1)} \u00b1 ${found.height_uncertainty_mm.toFixed(1)} mm`;
    return `\u2300 ${length}, ${height}, class ${found.size_class}`
      + (found.size_class_sure === false ? " or the one beside it" : "");
  }

  show() {
    this.draw();
  }

  list(found) {
    this.found = found;
    this.here = null;
    this.draw();
  }

  draw(circle = null) {
    const frame = this.page.frame;
    const here = frame ? this.found.filter((each) => each.frame === frame.frame) : [];
    this.rows(here);
    const hints = this.tool ? HINTS[this.tool] : null;
    put($("hint"), hints ? hints[Math.min(this.marks.length, hints.length - 1)] : HINTS.none);
    $("done").disabled = this.tool !== "polyp" || this.marks.length < 3 || this.busy;
    if (!frame) return;
    const segments = [], pins = [], overlays = [];
    for (const each of here) {
      overlays.push({ points: each.points_px, closed: each.kind === "polyp", dots: each.kind === "ruler" });
      if (!each.ends_mm.length) continue;
      segments.push(each.ends_mm);
      each.rim_mm.forEach((place, index) => segments.push(
        [place, each.rim_mm[(index + 1) % each.rim_mm.length]]));
      const [one, two] = each.ends_mm;
      pins.push({
        place: each.kind === "ruler" ? two : one,
        text: `${each.number}: ${spread(each.length_mm, each.uncertainty_mm)}`,
      });
    }
    const marks = this.marks.map(([u, v]) => this.page.stage.above(u, v)).filter(Boolean);
    if (this.marks.length) overlays.push({ points: this.marks, closed: false, dots: true });
    this.page.stage.overlay(segments, marks, pins);
    this.page.picture.overlay(overlays, circle);
  }

  rows(here) {
    const numbers = `${this.found.map((each) => each.number)}/${here.map((each) => each.number)}`;
    if (numbers === this.here) return;
    this.here = numbers;
    $("list").replaceChildren(...[...this.found].reverse().map((each) => {
      const row = document.createElement("li");
      row.classList.toggle("here", here.includes(each));
      const go = document.createElement("button");
      go.title = "Go to its frame";
      go.textContent = `${each.number}: ${this.words(each)}`;
      const small = document.createElement("small");
      small.textContent = `frame ${each.frame}` + (each.frames > 1 ? `, mean of ${each.frames}` : "");
      go.append(small);
      go.onclick = () => this.visit(each);
      const remove = document.createElement("button");
      remove.textContent = "\u2715";
      remove.title = "Remove from the list";
      remove.setAttribute("aria-label", `Remove measurement ${each.number}`);
      remove.onclick = () => this.page.ask({ do: "remove", number: each.number }).catch(
        (error) => this.page.say(error.message));
      row.append(go, remove);
      return row;
    }));
  }

  visit(each) {
    this.page.freeze();
    this.page.ask({ do: "position", frame: each.frame }).then(
      (position) => this.page.go(position), (error) => this.page.say(error.message));
  }

  // The capsule.

  registers(hello) {
    const form = $("registers");
    form.replaceChildren();
    for (const [name, { words, meaning }] of Object.entries(hello.registers)) {
      const label = document.createElement("label");
      label.textContent = words;
      label.title = meaning;
      label.htmlFor = `register-${name}`;
      const input = document.createElement("input");
      Object.assign(input, { type: "number", id: `register-${name}`, name, title: meaning, step: 1, disabled: true });
      input.oninput = () => this.edited(input);
      form.append(label, input);
    }
    const write = document.createElement("button");
    write.textContent = "Write";
    form.append(write);
  }

  // What was typed stays until it is written; an empty field shows the capsule's value again.
  edited(input) {
    input.classList.toggle("edited", input.value !== "" && input.value !== input.dataset.value);
  }

  values(registers) {
    for (const input of $("registers").querySelectorAll("input")) {
      const value = registers ? registers[input.name] : undefined;
      input.disabled = value === undefined;
      input.dataset.value = value ?? "";
      if (input.classList.contains("edited")) this.edited(input);
      else if (input !== document.activeElement) input.value = input.dataset.value;
    }
  }

  write() {
    const edited = [...$("registers").querySelectorAll("input.edited")];
    if (!edited.length) {
      this.page.say("Change a value first.");
      return;
    }
    const registers = Object.fromEntries(edited.map((input) => [input.name, Number(input.value)]));
    this.command("set", registers, () => {
      for (const input of edited) {
        input.dataset.value = registers[input.name];
        this.edited(input);
      }
    });
  }

  command(action, registers = {}, done = () => {}) {
    this.page.ask({ do: "chip", action, registers }).then(
      (words) => {
        this.page.say(words);
        done();
        if (["load", "start", "single", "pattern-only"].includes(action)) this.page.goOn();
      }, (error) => this.page.say(error.message));
  }

  state(state) {
    const doing = state.doing !== null;
    const mode = state.chip && (state.chip.as_images ? "images" : state.chip.mode);
    document.querySelectorAll("[data-chip]").forEach((button) => {
      button.disabled = doing;
      button.classList.toggle("on", button.dataset.chip === BUTTONS[mode]);
    });
    put($("chip").querySelector("summary"), doing ? `Capsule: ${state.doing}`
      : state.chip ? `Capsule: ${MODES[mode]}` : "Capsule");
    this.values(state.chip && state.chip.registers);
    // It opens by itself for a chip that has to be started, and closes when frames come.
    const idle = state.chip !== null && state.chip.mode === "stop" && !state.count;
    if (idle && !this.opened) $("chip").open = this.opened = true;
    if (state.count && this.opened) $("chip").open = this.opened = false;
  }
}
