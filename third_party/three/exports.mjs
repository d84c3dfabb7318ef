export {
  BufferAttribute, BufferGeometry, Color, ColorManagement, DoubleSide, Group,
  LineBasicMaterial, LinearSRGBColorSpace, LineSegments, Mesh,
  MeshBasicMaterial, PerspectiveCamera, Points, PointsMaterial, Scene,
  Texture, Vector3, WebGLRenderer,
} from 'three';
export { OrbitControls } from 'three/addons/controls/OrbitControls.js';
