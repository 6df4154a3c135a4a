// The plain picture with its spots, and what was marked in it.
const U = 1, V = 2, STATUS = 6;
const COLOURS = ["#35d07f", "#b0b0b0", "#ffb02e", "#ff5a4f", "#c58cff", "#ff7ad9", "#9a9a9a"];
const SCALE = 2;

export class Picture {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.frame = this.image = null;
    this.overlays = [];
    this.circle = null;
    this.lines = false; // where each beam's spot can be
  }

  rig(rig) {
    this.ways = rig.lines;
    this.size = [rig.width, rig.height];
    this.canvas.width = SCALE * rig.width;
    this.canvas.height = SCALE * rig.height;
    // A tall picture leaves room for what is below it.
    this.canvas.parentElement.style.maxWidth = `calc(40vh * ${rig.width / rig.height})`;
    this.plain = document.createElement("canvas");
    [this.plain.width, this.plain.height] = this.size;
    this.draw();
  }

  texture(head, grey) {
    const context = this.plain.getContext("2d");
    const image = context.createImageData(head.width, head.height);
    for (let at = 0, to = 0; at < grey.length; at++, to += 4) {
      image.data[to] = image.data[to + 1] = image.data[to + 2] = grey[at];
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
    if (!this.size) return;
    const context = this.context;
    const place = ([u, v]) => [(u + 0.5) * SCALE, (v + 0.5) * SCALE];
    context.imageSmoothingEnabled = true;
    context.drawImage(this.plain, 0, 0, this.canvas.width, this.canvas.height);
    context.lineWidth = 2;
    context.strokeStyle = "rgba(90, 160, 235, 0.75)";
    for (const way of this.lines ? this.ways : []) {
      context.beginPath();
      way.forEach((point, index) => context[index ? "lineTo" : "moveTo"](...place(point)));
      context.stroke();
    }
    for (const row of this.frame ? this.frame.points : []) {
      context.strokeStyle = COLOURS[row[STATUS]] || COLOURS[1];
      context.beginPath();
      context.arc(...place([row[U], row[V]]), 5, 0, 2 * Math.PI);
      context.stroke();
    }
    context.strokeStyle = context.fillStyle = "#ffd23e";
    for (const { points, closed, dots } of this.overlays) {
      context.beginPath();
      points.forEach((point, index) => context[index ? "lineTo" : "moveTo"](...place(point)));
      if (closed) context.closePath();
      context.stroke();
      if (dots) for (const point of points) {
        const [x, y] = place(point);
        context.fillRect(x - 4, y - 4, 8, 8);
      }
    }
    if (this.circle) {
      const [u, v, radius] = this.circle;
      context.beginPath();
      context.arc(...place([u, v]), radius * SCALE, 0, 2 * Math.PI);
      context.stroke();
    }
  }
}
