// Geometry of cameras and of what to look at: no drawing.

function rotate([x, y, z, w], [a, b, c]) {
  // v + 2 w (q x v) + 2 q x (q x v)
  const u = [y * c - z * b, z * a - x * c, x * b - y * a];
  const v = [y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0]];
  return [a + 2 * (w * u[0] + v[0]), b + 2 * (w * u[1] + v[1]),
    c + 2 * (w * u[2] + v[2])];
}

// Half of the image's size at unit depth.
function halfSize(camera) {
  const focal = camera ? camera.params[0] : 0;
  if (!(focal > 0)) return [0.5, 0.375];
  // Wide lenses would hide the scene behind their frusta.
  const scale = Math.min(1, 1.2 * 2 * focal / Math.max(camera.width, camera.height));
  return [scale * camera.width / (2 * focal), scale * camera.height / (2 * focal)];
}

// Upper left, upper right, lower right and lower left corner of the image.
function frustumCorners(image, camera, depth) {
  const [halfWidth, halfHeight] = halfSize(camera);
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => {
    const corner = rotate(image.rotation,
      [x * halfWidth * depth, y * halfHeight * depth, depth]);
    return corner.map((value, axisIndex) => value + image.center[axisIndex]);
  });
}

// Ends of the eight edges, one after the other.
function frustumEdges(image, camera, depth) {
  const corners = frustumCorners(image, camera, depth);
  const ends = [];
  corners.forEach((corner, i) => {
    ends.push(...image.center, ...corner, ...corner, ...corners[(i + 1) % 4]);
  });
  return ends;
}

function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

function normalized(vector, fallback) {
  const length = Math.hypot(...vector);
  return length > 1e-6 ? vector.map((value) => value / length) : fallback;
}

function cross([a, b, c], [x, y, z]) {
  return [b * z - c * y, c * x - a * z, a * y - b * x];
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// The box of the bulk of the points and all cameras: {center, extent}.
function boxOf(model) {
  const {positions, count: numPoints} = model.points;
  const stride = Math.max(1, Math.floor(numPoints / 20000));
  const low = [], high = [];
  for (let axisIndex = 0; axisIndex < 3; ++axisIndex) {
    const values = [];
    for (let i = 0; i < numPoints; i += stride) {
      values.push(positions[3 * i + axisIndex]);
    }
    values.sort((a, b) => a - b);
    const tail = Math.floor(0.03 * values.length);
    const inner = values.slice(tail, values.length - tail);
    for (const image of model.images) inner.push(image.center[axisIndex]);
    low.push(inner.reduce((a, b) => Math.min(a, b), Infinity));
    high.push(inner.reduce((a, b) => Math.max(a, b), -Infinity));
  }
  if (!Number.isFinite(low[0])) return {center: [0, 0, 0], extent: 1};
  const extent = distance(low, high);
  return {
    center: low.map((value, i) => (value + high[i]) / 2),
    extent: extent > 0 ? extent : 1,
  };
}

// Depth of frusta that do not overlap much: by the distance of neighbours.
function frustumDepth(model, extent) {
  const step = Math.max(1, Math.ceil(model.images.length / 300));
  const nearest = [];
  for (let i = 0; i < model.images.length; i += step) {
    let smallest = Infinity;
    for (const other of model.images) {
      if (other === model.images[i]) continue;
      smallest = Math.min(smallest, distance(model.images[i].center, other.center));
    }
    if (Number.isFinite(smallest)) nearest.push(smallest);
  }
  const wanted = nearest.length > 0 ? 0.6 * median(nearest) : Infinity;
  return Math.min(0.05 * extent, Math.max(0.004 * extent, wanted));
}

// Up, and the direction from which cameras look: {up, backward}.
function viewDirections(model) {
  const down = [0, 0, 0], forward = [0, 0, 0];
  for (const image of model.images) {
    rotate(image.rotation, [0, 1, 0]).forEach((value, i) => { down[i] += value; });
    rotate(image.rotation, [0, 0, 1]).forEach((value, i) => { forward[i] += value; });
  }
  const unitDown = normalized(down, [0, 1, 0]);
  const level = (vector) => {
    const height = dot(vector, unitDown);
    return vector.map((value, i) => value - height * unitDown[i]);
  };
  let ahead = level(forward.map((value) => value / Math.max(1, model.images.length)));
  // Cameras all around a scene have no common direction.
  if (Math.hypot(...ahead) < 0.1 && model.images.length > 0) {
    ahead = level(rotate(model.images[0].rotation, [0, 0, 1]));
  }
  const sideways = cross(unitDown, [1, 0, 0]);
  return {
    up: unitDown.map((value) => -value),
    backward: normalized(ahead, normalized(sideways, [0, 0, 1]))
      .map((value) => -value),
  };
}
