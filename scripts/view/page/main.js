// The page: one socket, one state, and the parts that show it.
import { Picture } from "./picture.js";
import { Stage } from "./stage.js";
import { Strip } from "./strip.js";
import { Tools } from "./tools.js";
import { put } from "./words.js";

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token");
const query = token ? `token=${encodeURIComponent(token)}` : "";

class Page {
  constructor() {
    this.frame = this.rig = this.state = null;
    this.live = this.following = this.playing = false;
    this.asked = new Map();
    this.number = 0;
    this.waiting = false; // a frame was asked for and has not come
    this.wanted = null;
    this.received = 0;
    this.unseen = false; // the server wants to know when it is drawn
    this.strip = new Strip(this);
    this.stage = new Stage($("view"), $("labels"));
    this.picture = new Picture($("picture"));
    this.tools = new Tools(this);
    this.controls();
    this.connect();
    setInterval(() => this.strip.tick(), 200);
    this.last = performance.now();
    requestAnimationFrame((now) => this.tick(now));
  }

  connect() {
    const socket = new WebSocket(`ws://${location.host}/socket${query && `?${query}`}`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = () => {
      this.waiting = false;
      for (const { refuse } of this.asked.values()) refuse(new Error("The program has ended."));
      this.asked.clear();
      this.strip.lost = true;
      this.say("The program that serves this page does not answer. What was recorded is kept; " +
        "start `cyclope view` again if it has ended.", "socket");
      setTimeout(() => this.connect(), 1000);
    };
    socket.onopen = () => { this.strip.lost = false; this.unsay("socket"); };
    this.socket = socket;
  }

  // Ask the server; resolves with its result, rejects with its sentence.
  ask(message) {
    return new Promise((resolve, refuse) => {
      if (this.socket.readyState !== WebSocket.OPEN) {
        refuse(new Error("The program does not answer."));
        return;
      }
      const id = ++this.number;
      this.asked.set(id, { resolve, refuse });
      this.socket.send(JSON.stringify({ id, ...message }));
    });
  }

  take(data) {
    if (data instanceof ArrayBuffer) {
      this.texture(data);
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "frame") this.show(message);
    else if (message.type === "state") this.stateChanged(message);
    else if (message.type === "measurements") this.tools.list(message.list);
    else if (message.type === "hello") this.begin(message);
    else if (message.type === "reply") {
      const asked = this.asked.get(message.id);
      this.asked.delete(message.id);
      if (!asked) return;
      if (message.ok) asked.resolve(message.result);
      else asked.refuse(new Error(message.error));
    }
  }

  get frozen() {
    return this.live && !this.following && this.frame !== null;
  }

  begin(hello) {
    this.rig = hello.rig;
    this.live = hello.live;
    if (this.following === false && !this.frame) this.following = this.live;
    this.strip.source(hello);
    this.stage.rig(hello.rig);
    this.picture.rig(hello.rig);
    this.tools.registers(hello);
    $("near").textContent = `${hello.rig.depth[0].toFixed(0)} mm`;
    $("far").textContent = `${hello.rig.depth[1].toFixed(0)} mm`;
    if (this.live && !this.following) this.ask({ do: "hold" }).catch(() => {});
    if (!this.live && this.frame) this.go(this.frame.position);
    this.buttons();
  }

  show(frame) {
    // Frozen, what was on its way already is not shown.
    if (this.frozen && !this.waiting) return;
    this.waiting = false;
    this.frame = frame;
    this.unseen = this.following;
    this.received = performance.now();
    $("empty").hidden = true;
    this.stage.show(frame);
    this.picture.show(frame);
    this.tools.show(frame);
    this.strip.show(frame);
    this.bar();
    for (const kind of ["ply", "glb", "pcd"]) {
      $(kind).href = `/frame.${kind}?frame=${frame.frame}${query && `&${query}`}`;
    }
    if (this.wanted !== null && this.wanted !== frame.position) this.go(this.wanted);
    else this.wanted = null;
  }

  texture(data) {
    const length = new DataView(data).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    if (this.frozen && head.frame !== this.frame.frame) return;
    const pixels = head.width * head.height;
    const octets = pixels * head.channels;
    const colours = new Uint8Array(data, 4 + length, octets);
    const age = new Uint8Array(data, 4 + length + octets, pixels);
    this.stage.texture(head, colours, age);
    this.picture.texture(head, colours);
    this.strip.texture(head);
  }

  stateChanged(state) {
    this.state = state;
    this.strip.state(state);
    if (state.trouble) this.say(state.trouble, "trouble");
    else this.unsay("trouble");
    if (state.chip && state.chip.as_images) this.say("The capsule sends the laser\u2019s patterns as " +
      "images, without points. They are written to the folder of the recording.", "images");
    else this.unsay("images");
    this.tools.state(state);
    if (!state.count) put($("empty"), this.live
      ? "Waiting for the first frame: start the capsule under \u201cCapsule\u201d."
      : "This recording has no frame.");
    this.bar();
  }

  // A sentence over the scene; each kind of them once, the last one is shown.
  say(text, kind = "said") {
    if (kind !== "said" && (this.sentences || []).some((each) => each.kind === kind && each.text === text)) return;
    this.sentences = (this.sentences || []).filter((each) => each.kind !== kind);
    this.sentences.push({ kind, text });
    put($("message"), text);
    if (kind === "said") {
      clearTimeout(this.silence);
      this.silence = setTimeout(() => this.unsay("said"), 6000);
    }
  }

  unsay(kind) {
    this.sentences = (this.sentences || []).filter((each) => each.kind !== kind);
    put($("message"), this.sentences.length ? this.sentences.at(-1).text : "");
  }

  // Time.

  bar() {
    const count = Math.max(this.state ? this.state.count : 0, this.frame ? this.frame.count : 0);
    const first = this.frame ? Math.max(this.frame.first, this.state ? this.state.first : 0) : 0;
    const bar = $("time");
    bar.min = first;
    bar.max = Math.max(count - 1, first);
    if (!this.dragging && this.frame) bar.value = this.frame.position;
    put($("when"), this.frame
      ? `frame ${this.frame.frame}, ${this.frame.seconds.toFixed(1)} s` : "no frame");
  }

  get end() {
    return Math.max(this.state ? this.state.count : 0, this.frame ? this.frame.count : 0) - 1;
  }

  buttons() {
    const moving = this.following || this.playing;
    $("freeze").textContent = moving ? "Freeze" : this.live ? "Live" : "Play";
    $("freeze").classList.toggle("on", moving);
  }

  freeze() {
    if (this.following) this.ask({ do: "hold" }).catch(() => {});
    this.following = this.playing = false;
    this.buttons();
  }

  goOn() {
    if (this.live) {
      this.following = true;
      this.ask({ do: "follow" }).catch((error) => this.say(error.message));
    } else {
      if (this.frame && this.frame.position >= this.end) this.go(this.frame.first);
      this.playing = true;
      this.at = null;
    }
    this.tools.choose(null);
    this.buttons();
  }

  // Ask for a frame; while one is under way only the last wish is kept.
  go(position) {
    this.wanted = Math.max(0, Math.min(position, this.end));
    if (this.waiting) return;
    this.waiting = true;
    this.ask({ do: "frame", position: this.wanted }).catch((error) => {
      this.waiting = false;
      this.wanted = null;
      this.say(error.message);
    });
  }

  step(by) {
    if (!this.frame) return;
    this.freeze();
    this.go((this.wanted ?? this.frame.position) + by);
  }

  tick(now) {
    requestAnimationFrame((later) => this.tick(later));
    const passed = Math.min(now - this.last, 250) / 1000;
    this.last = now;
    if (this.playing && this.frame) {
      this.at = (this.at ?? this.frame.position) +
        passed * (this.frame.strip.rate || 25) * Number($("speed").value);
      if (this.at >= this.end) {
        this.playing = false;
        this.buttons();
        this.go(this.end);
      } else if (Math.floor(this.at) > this.frame.position) this.go(Math.floor(this.at));
    }
    this.stage.render();
    this.picture.render();
    this.scale();
    if (this.unseen && this.socket.readyState === WebSocket.OPEN) {
      this.unseen = false;
      this.socket.send('{"do": "seen"}');
    }
  }

  scale() {
    const perPixel = this.stage.millimetresPerPixel();
    let length = 1;
    for (const step of [1, 2, 5, 10, 20, 50, 100]) if (step / perPixel <= 170) length = step;
    $("scale").style.width = `${Math.round(length / perPixel)}px`;
    put($("scale").firstElementChild, `${length} mm`);
  }

  controls() {
    const each = (name, work) => document.querySelectorAll(`[data-${name}]`).forEach(
      (button) => button.addEventListener("click", () => work(button.dataset[name], button)));
    each("colour", (name) => this.colour(name));
    each("toggle", (name) => this.toggle(name));
    each("view", (name) => this.stage.look(name));
    $("freeze").onclick = () => (this.following || this.playing ? this.freeze() : this.goOn());
    $("back").onclick = () => this.step(-1);
    $("next").onclick = () => this.step(1);
    const bar = $("time");
    bar.oninput = () => { this.dragging = true; this.freeze(); this.go(Number(bar.value)); };
    bar.onchange = () => { this.dragging = false; };
    $("help").onclick = () => $("keys").showModal();
    $("png").onclick = () => this.stage.save(`cyclope-${this.frame ? this.frame.frame : 0}.png`);
    $("csv").href = `/measurements.csv${query && `?${query}`}`;
    const system = matchMedia("(prefers-color-scheme: dark)");
    let theme = localStorage.getItem("theme") || (system.matches ? "dark" : "light");
    const paint = () => {
      document.documentElement.dataset.theme = theme;
      $("theme").textContent = theme === "dark" ? "Light" : "Dark";
      this.stage.paint();
    };
    $("theme").onclick = () => {
      theme = theme === "dark" ? "light" : "dark";
      localStorage.setItem("theme", theme);
      paint();
    };
    paint();
    document.addEventListener("keydown", (event) => this.key(event));
  }

  colour(name) {
    this.stage.colour(name);
    document.querySelectorAll("[data-colour]").forEach(
      (button) => button.classList.toggle("on", button.dataset.colour === name));
    $("legend").hidden = name !== "depth";
  }

  toggle(name) {
    const on = this.stage.toggle(name);
    if (name === "beams") {
      this.picture.lines = on;
      this.picture.draw();
    }
    document.querySelector(`[data-toggle="${name}"]`).classList.toggle("on", on);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || $("keys").open) return;
    if (/^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.id !== "time") return;
    const far = event.shiftKey ? 10 : 1;
    const work = {
      " ": () => $("freeze").click(), ArrowLeft: () => this.step(-far),
      ArrowRight: () => this.step(far), t: () => this.colour("texture"),
      d: () => this.colour("depth"), f: () => this.colour("age"), w: () => this.toggle("wire"),
      p: () => this.toggle("points"), b: () => this.toggle("beams"), o: () => this.toggle("flat"),
      h: () => this.stage.look("home"), 1: () => this.stage.look("left"),
      2: () => this.stage.look("top"), 3: () => this.stage.look("right"),
      r: () => this.tools.choose("ruler"), l: () => this.tools.choose("polyp"),
      Enter: () => this.tools.finish(), Escape: () => this.tools.choose(null),
      "?": () => $("keys").showModal(),
    }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!work || (event.key === "Enter" && event.target.tagName === "BUTTON")) return;
    event.preventDefault();
    work();
  }
}

window.page = new Page();
