// Words of the page: statuses of pairs, reasons of missing images, numbers.

const STATUSES = {
  valid: {
    label: 'valid', color: 'blue',
    meaning: 'takes part in the reconstruction',
  },
  too_few_matches: {
    label: 'too few matches', color: 'grey',
    meaning: 'fewer matches than prove anything',
  },
  no_geometry: {
    label: 'no geometry', color: 'slate',
    meaning: 'no relative pose was found',
  },
  too_few_inliers: {
    label: 'too few inliers', color: 'sand',
    meaning: 'too few matches agree with the relative pose',
  },
  low_inlier_ratio: {
    label: 'low inlier ratio', color: 'brown',
    meaning: 'too small a share of the matches agrees with the relative pose',
  },
  scale_out_of_range: {
    label: 'scale out of range', color: 'violet',
    meaning: 'the two depth maps differ in scale by an implausible factor',
  },
  depth_inconsistent: {
    label: 'depth inconsistent', color: 'purple',
    meaning: 'too few matches agree with the depth maps',
  },
  low_pair_score: {
    label: 'low pair score', color: 'pink',
    meaning: 'the imported score calls it a look-alike',
  },
  low_triplet_support: {
    label: 'low triplet support', color: 'rose',
    meaning: 'too few triplets of images support it',
  },
  rotation_outlier: {
    label: 'rotation outlier', color: 'red',
    meaning: 'its rotation contradicts the averaged rotations',
  },
  stationary: {
    label: 'stationary', color: 'olive',
    meaning: 'its matches do not move, as those of a watermark',
  },
  translation_outlier: {
    label: 'translation outlier', color: 'orange',
    meaning: 'its translation contradicts the loops that it is part of',
  },
  model_outlier: {
    label: 'model outlier', color: 'green',
    meaning: 'too few of its matches agree with the finished model',
  },
};

function statusWords(name) {
  return STATUSES[name] ||
      {label: name.replaceAll('_', ' '), color: 'grey', meaning: ''};
}

// What to do about an image that is missing, by its reason.
const ADVICE = [
  [/^no key points/,
    'Extract features for it, and check that it is sharp, not masked and not ' +
    'empty.'],
  [/^no matches/,
    'Match it with the others: exhaustive_matcher for small sets, or ' +
    'sequential and vocabulary-tree matching with loops. If it was matched, ' +
    'it may show another place.'],
  [/rotation only/,
    'Add images from other places that overlap with it, or its depth map.'],
  [/^no valid pair.*(too_few_inliers|too_few_matches|no_geometry)/,
    'Its matches are few or wrong: add images between it and its neighbours, ' +
    'or match with a dense or learned matcher (dense_match_importer).'],
  [/^no valid pair.*(rotation_outlier|translation_outlier|model_outlier)/,
    'Its pairs contradict the others, as look-alike places do. Leave it out ' +
    'if it shows another place; otherwise add overlapping images.'],
  [/^no valid pair/,
    'See why its pairs left in the view graph, and add overlapping images.'],
  [/^connected to only|fewer than .* images|not connected to the largest/,
    'Add images that connect its part with the rest. Small parts are written ' +
    'with a smaller --DepthGlobalMapper.min_model_size.'],
  [/^sees too few tracks/,
    'Add images that see the same things, or import its depth map.'],
  [/points after bundle adjustment/,
    'Add overlapping images. --DepthGlobalMapper.min_num_points_per_image ' +
    'is the limit.'],
  [/^implausible intrinsics/,
    'Check its camera: model, size and focal length, and whether it was ' +
    'cropped. A camera entry of its own may help.'],
  [/failed/,
    'See the log of the run; cameras with wrong focal lengths are the usual ' +
    'cause.'],
];

function adviceFor(reason) {
  const found = ADVICE.find(([pattern]) => pattern.test(reason));
  return found ? found[1] : 'Add images that overlap with it.';
}

// "no valid pair: 2 too_few_inliers" with the words of the page.
function reasonWords(reason) {
  return reason.replace(/\b[a-z]+(_[a-z]+)+\b/g,
    (name) => (STATUSES[name] ? STATUSES[name].label : name));
}

const UNITS = {
  metres: {
    short: 'm', label: 'metres',
    meaning: 'metric depth maps agree in scale',
  },
  depth_maps: {
    short: 'u', label: 'depth-map units',
    meaning: 'the depth maps are relative, or differ too much in scale',
  },
  arbitrary: {
    short: 'u', label: 'arbitrary',
    meaning: 'no depth map fixes the scale',
  },
};

function count(number, noun, plural = noun + 's') {
  return `${number.toLocaleString('en')} ${number === 1 ? noun : plural}`;
}

// A whole number as it is, another one with three significant digits; "-" for
// what is unknown.
function figure(value, unit = '') {
  if (typeof value !== 'number' || !Number.isFinite(value)) return '-';
  const size = Math.abs(value);
  const digits = Number.isInteger(value) || size >= 100 ? 0 :
    Math.min(6, 2 - Math.floor(Math.log10(size)));
  const text = value.toLocaleString('en', {
    minimumFractionDigits: digits, maximumFractionDigits: digits,
  });
  return unit ? `${text} ${unit}` : text;
}

function percent(ratio) {
  return Number.isFinite(ratio) ? `${figure(100 * ratio)} %` : '-';
}

function seconds(value) {
  if (value < 0.001) return '< 1 ms';
  if (value < 1) return `${Math.round(1000 * value)} ms`;
  if (value < 120) return figure(value, 's');
  const minutes = Math.floor(value / 60);
  return minutes < 120 ?
    `${minutes} min ${Math.round(value - 60 * minutes)} s` :
    `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

// "rotation_averaging" as "rotation averaging".
function spaced(name) {
  return name.replaceAll('_', ' ');
}

function median(values) {
  if (values.length === 0) return NaN;
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.floor(sorted.length / 2)];
}
