// The surface in three dimensions. Millimetres; x right, y down, z away from the camera, turned
// over into three.js's axes by the group.
import * as THREE from "./three.js";

const BEAM = 0, U = 1, V = 2, X = 3, Y = 4, Z = 5, STATUS = 6;
const OK = 0, DOUBTFUL = 5;
const NEVER = 255;
// Viridis, from far to near, at even steps.
const COLOURS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

export function depthColour(part) {
  const at = Math.max(0, Math.min(1, part)) * (COLOURS.length - 1);
  const low = Math.min(Math.floor(at), COLOURS.length - 2);
  return COLOURS[low].map((value, index) => value + (at - low) * (COLOURS[low + 1][index] - value));
}

function geometry(...names) {
  const made = new THREE.BufferGeometry();
  for (const name of names) made.setAttribute(name, new THREE.BufferAttribute(new Float32Array(0), 3));
  return made;
}

// Whether the processor draws, for want of graphics hardware: smooth edges then cost frames.
function software() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl && gl.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  if (gl) gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

export class Stage {
  constructor(canvas, labels) {
    this.canvas = canvas;
    this.labels = labels;
    const context = canvas.getContext("webgl2", { alpha: false, antialias: !software() });
    this.renderer = new THREE.WebGLRenderer({ canvas, context });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new THREE.Scene();
    this.world = new THREE.Group();
    this.world.scale.set(1, -1, -1);
    this.world.updateMatrixWorld();
    this.scene.add(this.world);
    this.scene.add(new THREE.AmbientLight(0xffffff, 1.2));
    const lamp = new THREE.DirectionalLight(0xffffff, 2.0);
    lamp.position.set(0.3, 0.4, 1);
    this.scene.add(lamp);
    this.perspective = new THREE.PerspectiveCamera(45, 1, 1, 2000);
    this.parallel = new THREE.OrthographicCamera(-1, 1, 1, -1, -1000, 3000);
    this.camera = this.perspective;
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => { this.dirty = true; });
    this.middle = new THREE.Vector3(0, 0, -60);
    this.shown = { wire: false, points: true, beams: false, flat: false };
    this.mode = "texture";
    this.frame = null;
    this.pins = [];
    this.make();
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.dirty = true;
  }

  make() {
    // Points and lines lie on the surface, and are seen before it.
    const both = {
      side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 40,
    };
    this.map = null;
    this.materials = {
      texture: new THREE.MeshBasicMaterial({ color: 0xb9a29a, ...both }),
      depth: new THREE.MeshLambertMaterial({ vertexColors: true, ...both }),
    };
    this.materials.age = this.materials.texture;
    this.surface = new THREE.Mesh(new THREE.BufferGeometry(), this.materials.texture);
    this.wire = new THREE.LineSegments(geometry("position"),
      new THREE.LineBasicMaterial({ color: 0x35b8a6 }));
    const dot = (color, size) => new THREE.Points(geometry("position"),
      new THREE.PointsMaterial({ color, size, sizeAttenuation: false }));
    this.points = dot(0x35d07f, 5);
    this.doubtful = dot(0xff4fb8, 7);
    this.beams = new THREE.LineSegments(geometry("position"),
      new THREE.LineBasicMaterial({ color: 0xff5a4f, transparent: true, opacity: 0.45 }));
    this.doubts = new THREE.LineSegments(geometry("position"),
      new THREE.LineBasicMaterial({ color: 0xff4fb8, transparent: true, opacity: 0.6 }));
    const over = { depthTest: false, transparent: true };
    this.measures = new THREE.LineSegments(geometry("position"),
      new THREE.LineBasicMaterial({ color: 0xffd23e, ...over }));
    this.marks = new THREE.Points(geometry("position"),
      new THREE.PointsMaterial({ color: 0xffd23e, size: 9, sizeAttenuation: false, ...over }));
    for (const each of [this.surface, this.wire, this.points, this.doubtful, this.beams,
      this.doubts, this.measures, this.marks]) {
      each.frustumCulled = false;
      this.world.add(each);
    }
    this.measures.renderOrder = this.marks.renderOrder = 2;
    this.apply();
  }

  rig(rig) {
    this.described = rig;
    this.middle.set(0, 0, -2 / (1 / rig.depth[0] + 1 / rig.depth[1]));
    const legend = document.querySelector("#legend canvas");
    const context = legend.getContext("2d");
    for (let row = 0; row < 128; row++) {
      context.fillStyle = `rgb(${depthColour(1 - row / 127).map(Math.round).join(",")})`;
      context.fillRect(0, row, 1, 1);
    }
    // As the capsule's camera sees it.
    this.field = 2 * Math.atan(rig.height / 2 / rig.focal) * 180 / Math.PI;
    this.look("home");
  }

  paint() {
    const colour = getComputedStyle(document.documentElement).getPropertyValue("--stage").trim();
    this.renderer.setClearColor(new THREE.Color(colour), 1);
    this.dirty = true;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.lens();
  }

  lens() {
    const aspect = this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
    this.perspective.aspect = aspect;
    this.perspective.fov = Math.min(70, (this.field || 45) * 1.12);
    this.perspective.updateProjectionMatrix();
    const distance = this.camera.position.distanceTo(this.controls.target);
    const half = this.reach || distance * Math.tan(this.perspective.fov * Math.PI / 360);
    Object.assign(this.parallel, { left: -half * aspect, right: half * aspect, top: half, bottom: -half });
    this.parallel.updateProjectionMatrix();
    this.dirty = true;
  }

  // Standard views of the surface's middle.
  look(name) {
    const centre = this.centre();
    const far = centre.length();
    const turned = { home: [0, 0], left: [-60, 0], right: [60, 0], top: [0, 60] }[name];
    const [around, up] = turned.map((angle) => angle * Math.PI / 180);
    const away = new THREE.Vector3(Math.sin(around) * Math.cos(up), Math.sin(up),
      Math.cos(around) * Math.cos(up));
    this.controls.target.copy(centre);
    this.camera.position.copy(name === "home" ? new THREE.Vector3(0, 0, 0)
      : centre.clone().addScaledVector(away, far));
    this.camera.up.set(0, 1, 0);
    this.parallel.zoom = 1;
    this.reach = far * Math.tan(Math.min(70, (this.field || 45) * 1.12) * Math.PI / 360);
    this.lens();
    this.controls.update();
    this.dirty = true;
  }

  centre() {
    const points = this.frame ? this.frame.points.filter((row) => row[STATUS] === OK && row[Z]) : [];
    if (!points.length) return this.middle.clone();
    const depths = points.map((row) => row[Z]).sort((one, two) => one - two);
    return new THREE.Vector3(0, 0, -depths[depths.length >> 1]);
  }

  toggle(name) {
    this.shown[name] = !this.shown[name];
    if (name === "flat") {
      const old = this.camera;
      this.camera = this.shown.flat ? this.parallel : this.perspective;
      this.camera.position.copy(old.position);
      this.camera.quaternion.copy(old.quaternion);
      const distance = old.position.distanceTo(this.controls.target);
      this.reach = distance * Math.tan(this.perspective.fov * Math.PI / 360);
      this.controls.object = this.camera;
      this.lens();
      this.controls.update();
    }
    this.apply();
    return this.shown[name];
  }

  colour(name) {
    this.mode = name;
    this.apply();
    this.texels();
  }

  apply() {
    this.surface.material = this.materials[this.mode];
    this.wire.visible = this.shown.wire;
    this.points.visible = this.doubtful.visible = this.shown.points;
    this.doubts.visible = this.shown.points;
    this.beams.visible = this.shown.beams;
    this.dirty = true;
  }

  show(frame) {
    const first = !this.frame;
    this.frame = frame;
    const rows = frame.points, rig = this.described;
    const place = (row) => [row[X], row[Y], row[Z]];
    const ok = rows.filter((row) => row[STATUS] === OK && row[Z] !== null);
    const doubtful = rows.filter((row) => row[STATUS] === DOUBTFUL && row[Z] !== null);
    const position = new Float32Array(rows.length * 3), uv = new Float32Array(rows.length * 2);
    const colour = new Float32Array(rows.length * 3);
    const [near, far] = rig.depth;
    rows.forEach((row, at) => {
      if (row[Z] === null) return;
      position.set(place(row), 3 * at);
      uv.set([(row[U] + 0.5) / rig.width, (row[V] + 0.5) / rig.height], 2 * at);
      const shade = new THREE.Color().setRGB(
        ...depthColour((1 / row[Z] - 1 / far) / (1 / near - 1 / far)).map((value) => value / 255),
        THREE.SRGBColorSpace);
      colour.set([shade.r, shade.g, shade.b], 3 * at);
    });
    const made = new THREE.BufferGeometry();
    made.setAttribute("position", new THREE.BufferAttribute(position, 3));
    made.setAttribute("uv", new THREE.BufferAttribute(uv, 2));
    made.setAttribute("color", new THREE.BufferAttribute(colour, 3));
    made.setIndex(frame.triangles);
    made.computeVertexNormals();
    this.replace(this.surface, made);
    this.fill(this.points, ok.flatMap(place));
    this.fill(this.doubtful, doubtful.flatMap(place));
    this.fill(this.beams, ok.flatMap((row) => [...rig.projector, ...place(row)]));
    this.fill(this.doubts, doubtful.flatMap((row) => [...rig.projector, ...place(row)]));
    const edges = [];
    for (let at = 0; at < frame.triangles.length; at += 3) {
      const [one, two, three] = frame.triangles.slice(at, at + 3).map((index) => place(rows[index]));
      edges.push(...one, ...two, ...two, ...three, ...three, ...one);
    }
    this.fill(this.wire, edges);
    if (first) this.look("home");
    this.dirty = true;
  }

  fill(object, numbers) {
    const made = new THREE.BufferGeometry();
    made.setAttribute("position", new THREE.BufferAttribute(new Float32Array(numbers), 3));
    this.replace(object, made);
  }

  replace(object, made) {
    object.geometry.dispose();
    object.geometry = made;
  }

  // Grey values, or red, green, blue of each pixel.
  texture(head, colours, age) {
    this.latest = { head, colours: colours.slice(), age: age.slice() };
    this.texels();
  }

  // The picture, and where it is old: from its own colour to blue; places that never came are plain.
  texels() {
    if (!this.latest) return;
    const { head, colours, age } = this.latest;
    if (!this.map || this.map.image.width !== head.width || this.map.image.height !== head.height) {
      if (this.map) this.map.dispose();
      this.map = new THREE.DataTexture(new Uint8Array(4 * age.length), head.width, head.height,
        THREE.RGBAFormat);
      this.map.colorSpace = THREE.SRGBColorSpace;
      this.map.minFilter = this.map.magFilter = THREE.LinearFilter;
      this.materials.texture.map = this.map;
      this.materials.texture.color.set(0xffffff);
      this.materials.texture.needsUpdate = true;
    }
    const data = this.map.image.data, fades = this.mode === "age";
    const step = this.described.age_step / 10; // all blue after ten seconds
    const each = head.channels, green = each === 3 ? 1 : 0, blue = each === 3 ? 2 : 0;
    for (let at = 0, from = 0, to = 0; at < age.length; at++, from += each, to += 4) {
      let part = 0;
      if (age[at] === NEVER) {
        data[to] = 150; data[to + 1] = 132; data[to + 2] = 126;
      } else {
        if (fades) part = Math.min(1, age[at] * step);
        data[to] = colours[from] * (1 - part) + 30 * part;
        data[to + 1] = colours[from + green] * (1 - part) + 60 * part;
        data[to + 2] = colours[from + blue] * (1 - part) + 220 * part;
      }
      data[to + 3] = 255;
    }
    this.map.needsUpdate = true;
    this.dirty = true;
  }

  // The picture's coordinates under the pointer, where there is surface; null elsewhere.
  pick(event) {
    if (!this.frame || !this.frame.triangles.length) return null;
    const box = this.canvas.getBoundingClientRect();
    const ray = new THREE.Raycaster();
    this.camera.updateMatrixWorld();
    ray.setFromCamera(new THREE.Vector2(
      2 * (event.clientX - box.left) / box.width - 1,
      1 - 2 * (event.clientY - box.top) / box.height), this.camera);
    const hit = ray.intersectObject(this.surface)[0];
    if (!hit) return null;
    const rows = [hit.face.a, hit.face.b, hit.face.c].map((index) => this.frame.points[index]);
    const local = this.world.worldToLocal(hit.point.clone());
    const [a, b, c] = rows.map((row) => new THREE.Vector3(row[X], row[Y], row[Z]));
    const normal = b.clone().sub(a).cross(c.clone().sub(a));
    const part = (one, two) => two.clone().sub(one).cross(local.clone().sub(one)).dot(normal)
      / normal.lengthSq();
    // Seen by the camera a corner counts by its depth.
    const weights = [part(b, c), part(c, a), part(a, b)].map((value, index) => value * rows[index][Z]);
    const total = weights[0] + weights[1] + weights[2];
    return [U, V].map((name) => rows.reduce(
      (sum, row, index) => sum + row[name] * weights[index] / total, 0));
  }

  // Where a place in mm is on the canvas, in its own pixels.
  project(place) {
    this.camera.updateMatrixWorld();
    const at = this.world.localToWorld(new THREE.Vector3(...place)).project(this.camera);
    return [(at.x + 1) / 2 * this.canvas.clientWidth, (1 - at.y) / 2 * this.canvas.clientHeight, at.z];
  }

  // Lines and labels of measurements, and marks of a tool that are not measured yet.
  overlay(segments, marks, pins) {
    this.fill(this.measures, segments.flat(2));
    this.fill(this.marks, marks.flat());
    this.pins = pins;
    this.labels.replaceChildren(...pins.map(({ text }) => {
      const label = document.createElement("span");
      label.textContent = text;
      return label;
    }));
    this.dirty = true;
  }

  // The surface's place near coordinates of the picture, for marks; null where there is none.
  above(u, v) {
    const frame = this.frame, rows = frame.points;
    for (let at = 0; at < frame.triangles.length; at += 3) {
      const [a, b, c] = frame.triangles.slice(at, at + 3).map((index) => rows[index]);
      const area = (b[U] - a[U]) * (c[V] - a[V]) - (b[V] - a[V]) * (c[U] - a[U]);
      const one = ((u - a[U]) * (c[V] - a[V]) - (v - a[V]) * (c[U] - a[U])) / area;
      const two = ((b[U] - a[U]) * (v - a[V]) - (b[V] - a[V]) * (u - a[U])) / area;
      if (one < 0 || two < 0 || one + two > 1) continue;
      const parts = [(1 - one - two) / a[Z], one / b[Z], two / c[Z]];
      const sum = parts[0] + parts[1] + parts[2];
      return [X, Y, Z].map((name) => (parts[0] * a[name] + parts[1] * b[name] + parts[2] * c[name]) / sum);
    }
    return null;
  }

  millimetresPerPixel() {
    const height = Math.max(this.canvas.clientHeight, 1);
    if (this.camera === this.parallel) {
      return (this.parallel.top - this.parallel.bottom) / this.parallel.zoom / height;
    }
    const distance = this.camera.position.distanceTo(this.controls.target);
    return 2 * distance * Math.tan(this.perspective.fov * Math.PI / 360) / height;
  }

  render() {
    if (!this.dirty) return;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    this.pins.forEach(({ place }, index) => {
      const [x, y, z] = this.project(place);
      const label = this.labels.children[index];
      label.style.left = `${x}px`;
      label.style.top = `${y}px`;
      label.hidden = z > 1;
    });
  }

  save(name) {
    this.dirty = true;
    this.render();
    this.canvas.toBlob((blob) => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
  }
}
