// The 3D view: points, cameras and pairs of one model, drawn when something
// changes. Colours pass through unconverted, as they are those of the images.

THREE.ColorManagement.enabled = false;

const PICK_RADIUS_PX = 12;

function lineGeometry(ends) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position',
    new THREE.BufferAttribute(Float32Array.from(ends), 3));
  return geometry;
}

class SceneView {
  // `onPick` gets {image} or {point}, an index of the shown points, or null.
  constructor(canvas, context, onPick) {
    this.canvas = canvas;
    this.onPick = onPick;
    this.renderer = new THREE.WebGLRenderer({canvas, context});
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.camera = new THREE.PerspectiveCamera(45, 1, 0.01, 1000);
    this.isDrawPending = false;
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    this.listenToPointer();
    for (const type of ['focus', 'blur']) {
      canvas.addEventListener(type, () => {
        if (this.controls) this.controls.enableZoom = type === 'focus';
      });
    }
    onThemeChange(() => this.applyTheme());
  }

  show(model, pairs, images) {
    this.model = model;
    this.pairs = pairs;
    this.images = images;
    this.scene = new THREE.Scene();
    const {center, extent} = boxOf(model);
    this.center = center;
    this.extent = extent;
    this.depth = frustumDepth(model, extent);
    this.addPoints();
    this.addFrusta();
    this.edges = new Map();
    this.selection = new THREE.Group();
    this.scene.add(this.selection);
    this.applyTheme();
    this.resetView();
  }

  addPoints() {
    const {positions, colors, count: numPoints} = this.model.points;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    this.isColored = colors.some((value) => value > 0);
    if (this.isColored) {
      geometry.setAttribute('color', new THREE.BufferAttribute(colors, 3, true));
    }
    const size = numPoints > 60000 ? 1.6 : numPoints > 8000 ? 2.2 : 3;
    this.points = new THREE.Points(geometry, new THREE.PointsMaterial({
      size: size * this.renderer.getPixelRatio(), sizeAttenuation: false,
      vertexColors: this.isColored,
    }));
    this.scene.add(this.points);
  }

  addFrusta() {
    const ends = this.model.images.flatMap((image) => frustumEdges(
      image, cameraOfImage(this.model, image), this.depth));
    this.frusta = new THREE.LineSegments(lineGeometry(ends),
      new THREE.LineBasicMaterial());
    this.scene.add(this.frusta);
  }

  // Lines between the cameras of some pairs.
  pairLines(pairIndices, colorName, opacity) {
    const ends = [];
    for (const pair of pairIndices) {
      const first = this.images[this.pairs.images[2 * pair]];
      const second = this.images[this.pairs.images[2 * pair + 1]];
      if (first.model !== this.model.index || second.model !== this.model.index) {
        continue;
      }
      ends.push(...first.center, ...second.center);
    }
    const lines = new THREE.LineSegments(lineGeometry(ends),
      new THREE.LineBasicMaterial({transparent: true, opacity}));
    lines.userData.colorName = colorName;
    lines.material.color.set(themeColor(colorName));
    return lines;
  }

  showPairs(status, isShown) {
    if (isShown && !this.edges.has(status)) {
      const indices = [];
      for (let i = 0; i < this.pairs.count; ++i) {
        if (this.pairs.statuses[i] === status) indices.push(i);
      }
      const {color} = statusWords(this.pairs.statusNames[status]);
      const opacity = indices.length > 2000 ? 0.25 : 0.7;
      this.edges.set(status, this.pairLines(indices, color, opacity));
      this.scene.add(this.edges.get(status));
    }
    if (this.edges.has(status)) this.edges.get(status).visible = isShown;
    this.draw();
  }

  applyTheme() {
    if (!this.scene) return;
    this.scene.background = new THREE.Color(themeColor('scene'));
    this.frusta.material.color.set(themeColor('frustum'));
    if (!this.isColored) this.points.material.color.set(themeColor('muted'));
    this.scene.traverse((node) => {
      if (node.userData.colorName) {
        node.material.color.set(themeColor(node.userData.colorName));
      }
    });
    this.draw();
  }

  addSelected(ends, colorName) {
    const lines = new THREE.LineSegments(lineGeometry(ends),
      new THREE.LineBasicMaterial());
    lines.userData.colorName = colorName;
    lines.material.color.set(themeColor(colorName));
    lines.renderOrder = 1;
    this.selection.add(lines);
  }

  clearSelection() {
    this.selection.traverse((node) => {
      if (node.geometry) node.geometry.dispose();
      if (node.material) node.material.dispose();
    });
    this.selection.clear();
  }

  // The image in its frustum, twice as large, with its pairs.
  selectImage(image) {
    this.clearSelection();
    const camera = cameraOfImage(this.model, image);
    this.addSelected(frustumEdges(image, camera, 2 * this.depth), 'selected');
    this.addPicture(image, frustumCorners(image, camera, 2 * this.depth));
    const byColor = new Map();
    for (const pair of pairsOfImage(this.pairs, image.index)) {
      const {color} = statusWords(this.pairs.statusNames[this.pairs.statuses[pair]]);
      byColor.set(color, [...(byColor.get(color) || []), pair]);
    }
    for (const [color, indices] of byColor) {
      this.selection.add(this.pairLines(indices, color, 0.8));
    }
    this.draw();
  }

  addPicture(image, corners) {
    if (!image.thumbnail) return;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position',
      new THREE.BufferAttribute(Float32Array.from(corners.flat()), 3));
    geometry.setAttribute('uv',
      new THREE.BufferAttribute(Float32Array.from([0, 1, 1, 1, 1, 0, 0, 0]), 2));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const texture = new THREE.Texture(new Image());
    const material = new THREE.MeshBasicMaterial({
      map: texture, side: THREE.DoubleSide, transparent: true, opacity: 0.9,
    });
    texture.image.onload = () => {
      texture.needsUpdate = true;
      this.selection.add(new THREE.Mesh(geometry, material));
      this.draw();
    };
    texture.image.src = 'data:image/jpeg;base64,' + image.thumbnail;
  }

  // The point with its viewing rays.
  selectPoint(index) {
    this.clearSelection();
    const {positions, starts, viewImages} = this.model.points;
    const xyz = positions.slice(3 * index, 3 * index + 3);
    const ends = [];
    for (let i = starts[index]; i < starts[index + 1]; ++i) {
      const image = this.images[viewImages[i]];
      ends.push(...xyz, ...image.center);
    }
    this.addSelected(ends, 'selected');
    const geometry = lineGeometry(xyz);
    const mark = new THREE.Points(geometry, new THREE.PointsMaterial({
      size: 9 * this.renderer.getPixelRatio(), sizeAttenuation: false,
      depthTest: false,
    }));
    mark.userData.colorName = 'selected';
    mark.material.color.set(themeColor('selected'));
    this.selection.add(mark);
    this.draw();
  }

  selectNothing() {
    this.clearSelection();
    this.draw();
  }

  resetView() {
    const {up, backward} = viewDirections(this.model);
    const side = cross(up, backward);
    const offset = backward.map((value, i) => 0.75 * value + 0.45 * up[i] + 0.35 * side[i]);
    const away = normalized(offset, up);
    this.placeCamera(up, away, 0.95 * this.extent);
    this.canvas.setAttribute('data-ready', 'true');
  }

  placeCamera(up, away, far) {
    this.camera.up.set(...up);
    this.camera.near = this.extent * 1e-3;
    this.camera.far = this.extent * 50;
    this.camera.position.set(...this.center.map((value, i) => value + far * away[i]));
    if (this.controls) this.controls.dispose();
    // It takes "up" when it is made.
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.target.set(...this.center);
    this.controls.minDistance = this.extent * 2e-3;
    this.controls.maxDistance = this.extent * 10;
    this.controls.zoomToCursor = true;
    // Until the view is in use the wheel scrolls the page.
    this.controls.enableZoom = document.activeElement === this.canvas;
    this.controls.addEventListener('change', () => this.draw());
    this.controls.update();
    this.resize();
  }

  // Turns about the target, by angles in radians.
  turn(aroundUp, upwards) {
    const up = this.camera.up.clone().normalize();
    const offset = this.camera.position.clone().sub(this.controls.target);
    offset.applyAxisAngle(up, aroundUp);
    const side = up.clone().cross(offset).normalize();
    const turned = offset.clone().applyAxisAngle(side, -upwards);
    // Not over the pole.
    if (Math.abs(turned.clone().normalize().dot(up)) < 0.98) offset.copy(turned);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.draw();
  }

  zoom(factor) {
    const {target} = this.controls;
    this.camera.position.sub(target).multiplyScalar(factor).add(target);
    this.controls.update();
    this.draw();
  }

  // Moves the view by parts of its height.
  shift(right, up) {
    const {target} = this.controls;
    const length = this.camera.position.distanceTo(target);
    const move = new THREE.Vector3(right, up, 0).multiplyScalar(length)
      .applyQuaternion(this.camera.quaternion);
    target.add(move);
    this.camera.position.add(move);
    this.controls.update();
    this.draw();
  }

  resize() {
    const {clientWidth, clientHeight} = this.canvas.parentElement;
    if (!this.scene || clientWidth === 0 || clientHeight === 0) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    if (this.isDrawPending || !this.controls) return;
    this.isDrawPending = true;
    requestAnimationFrame(() => {
      this.isDrawPending = false;
      this.renderer.render(this.scene, this.camera);
    });
  }

  // A press that does not drag picks.
  listenToPointer() {
    let start = null;
    this.canvas.addEventListener('pointerdown', (event) => {
      start = event.button === 0 ? [event.clientX, event.clientY] : null;
    });
    this.canvas.addEventListener('pointerup', (event) => {
      if (!start) return;
      const moved = Math.hypot(event.clientX - start[0], event.clientY - start[1]);
      start = null;
      if (moved > 4) return;
      const box = this.canvas.getBoundingClientRect();
      this.onPick(this.pick(event.clientX - box.left, event.clientY - box.top));
    });
  }

  // A camera near the place, else the nearest of the points there.
  pick(x, y) {
    this.camera.updateMatrixWorld();
    const projected = new THREE.Vector3();
    const {clientWidth, clientHeight} = this.canvas;
    const distanceTo = (a, b, c) => {
      projected.set(a, b, c).project(this.camera);
      if (projected.z < -1 || projected.z > 1) return Infinity;
      return Math.hypot((projected.x + 1) / 2 * clientWidth - x,
        (1 - projected.y) / 2 * clientHeight - y);
    };
    let picked = null;
    let nearest = PICK_RADIUS_PX;
    for (const image of this.model.images) {
      const away = distanceTo(...image.center);
      if (away < nearest) {
        nearest = away;
        picked = {image};
      }
    }
    if (picked) return picked;
    const {positions, count: numPoints} = this.model.points;
    let depth = Infinity;
    for (let i = 0; i < numPoints; ++i) {
      const away = distanceTo(positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]);
      if (away < PICK_RADIUS_PX / 2 && projected.z < depth) {
        depth = projected.z;
        picked = {point: i};
      }
    }
    return picked;
  }
}
