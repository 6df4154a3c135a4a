// The plain picture with its spots, and what was marked in it.
const U = 1, V = 2, STATUS = 6;
const COLOURS = ["#35d07f", "#b0b0b0", "#ffb02e", "#ff5a4f", "#c58cff", "#ff7ad9", "#9a9a9a"];
// Pixels of the canvas: as many as the screen shows of it, and some of those for a dot of a line.
const DOT = Math.min(devicePixelRatio, 2), WIDTH = 320 * DOT;

// A circle for each colour, drawn once: the browser copies it faster than it draws one anew.
const RADIUS = 2.5 * DOT, SIDE = Math.ceil(2 * RADIUS + 2 * DOT);
const circles = new Map();
function circleOf(colour) {
  if (!circles.has(colour)) {
    const canvas = Object.assign(document.createElement("canvas"), { width: SIDE, height: SIDE });
    const context = canvas.getContext("2d");
    context.lineWidth = 1.4 * DOT;
    context.strokeStyle = colour;
    context.arc(SIDE / 2, SIDE / 2, RADIUS, 0, 2 * Math.PI);
    context.stroke();
    circles.set(colour, canvas);
  }
  return circles.get(colour);
}

export class Picture {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.frame = this.image = null;
    this.overlays = [];
    this.circle = null;
    this.dirty = true;
    this.lines = false; // where each beam's spot can be
  }

  rig(rig) {
    this.ways = rig.lines;
    this.size = [rig.width, rig.height];
    this.scale = WIDTH / rig.width;
    this.canvas.width = WIDTH;
    this.canvas.height = Math.round(this.scale * rig.height);
    // A tall picture leaves room for what is below it.
    this.canvas.parentElement.style.maxWidth = `calc(40vh * ${rig.width / rig.height})`;
    this.plain = document.createElement("canvas");
    [this.plain.width, this.plain.height] = this.size;
    this.draw();
  }

  texture(head, colours) {
    const context = this.plain.getContext("2d");
    const image = context.createImageData(head.width, head.height);
    const each = head.channels, green = each === 3 ? 1 : 0, blue = each === 3 ? 2 : 0;
    for (let from = 0, to = 0; from < colours.length; from += each, to += 4) {
      image.data[to] = colours[from];
      image.data[to + 1] = colours[from + green];
      image.data[to + 2] = colours[from + blue];
      image.data[to + 3] = 255;
    }
    context.putImageData(image, 0, 0);
    this.draw();
  }

  show(frame) {
    this.frame = frame;
    this.draw();
  }

  // Lines through points of the picture: {points, closed, dots}.
  overlay(overlays, circle = null) {
    this.overlays = overlays;
    this.circle = circle;
    this.draw();
  }

  // Coordinates of the picture under the pointer.
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width * this.size[0] - 0.5,
      (event.clientY - box.top) / box.height * this.size[1] - 0.5];
  }

  draw() {
    this.dirty = true;
  }

  // Once for each picture of the screen, whatever has changed.
  render() {
    if (!this.size || !this.dirty) return;
    this.dirty = false;
    const context = this.context;
    const place = ([u, v]) => [(u + 0.5) * this.scale, (v + 0.5) * this.scale];
    context.imageSmoothingEnabled = true;
    context.drawImage(this.plain, 0, 0, this.canvas.width, this.canvas.height);
    context.lineWidth = DOT;
    context.strokeStyle = "rgba(90, 160, 235, 0.75)";
    for (const way of this.lines ? this.ways : []) {
      context.beginPath();
      way.forEach((point, index) => context[index ? "lineTo" : "moveTo"](...place(point)));
      context.stroke();
    }
    for (const row of this.frame ? this.frame.points : []) {
      const [x, y] = place([row[U], row[V]]);
      context.drawImage(circleOf(COLOURS[row[STATUS]] || COLOURS[1]), x - SIDE / 2, y - SIDE / 2);
    }
    context.strokeStyle = context.fillStyle = "#ffd23e";
    for (const { points, closed, dots } of this.overlays) {
      context.beginPath();
      points.forEach((point, index) => context[index ? "lineTo" : "moveTo"](...place(point)));
      if (closed) context.closePath();
      context.stroke();
      if (dots) for (const point of points) {
        const [x, y] = place(point);
        context.fillRect(x - 2 * DOT, y - 2 * DOT, 4 * DOT, 4 * DOT);
      }
    }
    if (this.circle) {
      const [u, v, radius] = this.circle;
      context.beginPath();
      context.arc(...place([u, v]), radius * this.scale, 0, 2 * Math.PI);
      context.stroke();
    }
  }
}
