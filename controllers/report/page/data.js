// The data of the page, with binary arrays decoded and what follows from them.

function decode(text, Type) {
  if (Uint8Array.fromBase64) return new Type(Uint8Array.fromBase64(text).buffer);
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; ++i) bytes[i] = characters.charCodeAt(i);
  return new Type(bytes.buffer);
}

function decodePoints(points) {
  const trackLengths = decode(points.track_lengths, Uint32Array);
  const starts = new Uint32Array(trackLengths.length + 1);
  trackLengths.forEach((length, i) => {
    starts[i + 1] = starts[i] + length;
  });
  return {
    count: points.count,
    positions: decode(points.positions, Float32Array),
    colors: decode(points.colors, Uint8Array),
    starts,
    viewImages: decode(points.view_images,
      points.view_image_bytes === 2 ? Uint16Array : Uint32Array),
    viewPositions: decode(points.view_positions, Uint8Array),
  };
}

function decodePairs(pairs) {
  return {
    count: pairs.count,
    statusNames: pairs.status_names,
    images: decode(pairs.images, Uint32Array),
    statuses: decode(pairs.statuses, Uint8Array),
    numMatches: decode(pairs.num_matches, Uint32Array),
    numInliers: decode(pairs.num_inliers, Uint32Array),
  };
}

// Statuses with their numbers of pairs: valid first, then most frequent.
function statusCounts(pairs) {
  const counts = new Array(pairs.statusNames.length).fill(0);
  for (const status of pairs.statuses) ++counts[status];
  return counts
    .map((number, index) => ({index, name: pairs.statusNames[index], number}))
    .sort((a, b) => (b.name === 'valid') - (a.name === 'valid') ||
                    b.number - a.number);
}

function readReportData() {
  const node = document.getElementById('report-data');
  const data = JSON.parse(node.textContent);
  node.remove();
  data.images.forEach((image, index) => {
    image.index = index;
  });
  for (const [index, model] of data.models.entries()) {
    model.index = index;
    model.points = decodePoints(model.points);
    model.images = data.images.filter((image) => image.model === index);
    // Models are in the order of their folders, "0", "1" and so on.
    model.figures = data.report && data.report.models ?
      data.report.models[Number(model.name)] : null;
  }
  data.pairs = decodePairs(data.pairs);
  data.pairs.counts = statusCounts(data.pairs);
  data.missing = data.report ?
    data.images.filter((image) => image.model === undefined) : [];
  return data;
}

// Indices of the pairs of an image.
function pairsOfImage(pairs, imageIndex) {
  const found = [];
  for (let i = 0; i < pairs.count; ++i) {
    if (pairs.images[2 * i] === imageIndex ||
        pairs.images[2 * i + 1] === imageIndex) {
      found.push(i);
    }
  }
  return found;
}

function cameraOfImage(model, image) {
  return model.cameras[image.camera_id];
}
