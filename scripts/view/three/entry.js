// What the page uses of three.js; see README.md beside it.
export {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DataTexture, DirectionalLight, DoubleSide,
  Group, LineBasicMaterial, LineSegments, LinearFilter, Mesh, MeshBasicMaterial,
  MeshLambertMaterial, OrthographicCamera, PerspectiveCamera, Points, PointsMaterial, RGBAFormat,
  Raycaster, SRGBColorSpace, Scene, Vector2, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
