// The sections of the page, each as a card of what the data have for it.

function card(id, title, ...children) {
  return element('section', {class: 'card', id, 'aria-labelledby': id + '-title'},
    element('h2', {id: id + '-title'}, title), children);
}

function help(...text) {
  return element('p', {class: 'help'}, text);
}

function tile(label, value, note, kind = '') {
  return element('div', {class: 'tile ' + kind},
    element('dt', {}, label), element('dd', {}, element('strong', {}, value),
      note && element('span', {class: 'tile-note'}, note)));
}

function imageButton(image, sceneCard) {
  return element('button', {
    type: 'button', class: 'link', title: 'Show in the 3D view',
    onclick: () => sceneCard.reveal(image),
  }, image.name);
}

// ----- Summary and what to look at

function unitTile(models) {
  const figures = models.length > 0 && models[0].figures;
  if (!figures) return null;
  const unit = UNITS[figures.unit] || {label: figures.unit, meaning: ''};
  const spread = 100 * Math.expm1(figures.depth_scale_log_spread);
  return tile('Unit', unit.label, figures.images_with_depth_scale > 0 ?
    `${count(figures.images_with_depth_scale, 'depth map')}, scales differ by ` +
    `${figure(spread)} %` : unit.meaning);
}

function repeatabilityTile(report) {
  const measured = report && report.repeatability;
  return measured ? tile('Repeatability', figure(measured.median_rotation_deg, '°'),
    'median rotation between two halves of the points') : null;
}

function timeTile(report) {
  const stages = report && report.stages || [];
  if (stages.length === 0) return null;
  const total = stages.reduce((sum, stage) => sum + stage.seconds, 0);
  const memory = Math.max(...stages.map((stage) => stage.peak_memory_mb));
  return tile('Time', seconds(total), `${figure(memory, 'MB')} of memory at most`);
}

function summarySection(data) {
  const {models, images, missing, report} = data;
  const registered = images.length - missing.length;
  const total = (key) => models.reduce((sum, model) => sum + model[key], 0);
  const numPoints = total('num_points');
  return element('section', {id: 'summary', 'aria-label': 'Summary'},
    element('dl', {class: 'tiles'},
      tile('Images registered', report ?
        `${plainNumber(registered)} of ${plainNumber(images.length)}` :
        plainNumber(registered),
      models.length === 1 ? 'in one model' : `in ${models.length} models`,
      missing.length > 0 ? 'odd' : ''),
      tile('Points', plainNumber(numPoints), numPoints > 0 ?
        `seen by ${figure(total('num_observations') / numPoints)} images each` : ''),
      models.length > 0 && tile('Median reprojection error',
        figure(models[0].median_error_px, 'px'),
        models.length > 1 ? 'of the largest model' : 'over all observations'),
      unitTile(models),
      repeatabilityTile(report),
      timeTile(report)));
}

function worthALook(data) {
  const notes = [...(data.report && data.report.warnings || [])];
  if (data.models.length === 0) {
    notes.push('No model could be reconstructed. The reasons are below, image ' +
      'by image.');
  } else if (data.missing.length > 0) {
    const one = data.missing.length === 1;
    notes.push([`${count(data.missing.length, 'image')} of ` +
      `${plainNumber(data.images.length)} ${one ? 'is' : 'are'} missing. `,
    element('a', {href: '#missing'}, 'See why, and what to do'), '.']);
  }
  if (data.models.length > 1) {
    notes.push(`The images fell apart into ${data.models.length} models, which ` +
      'no valid pair connects. Images that see parts of two of them would ' +
      'join them.');
  }
  const weak = data.images.filter((image) =>
    image.model !== undefined && image.coverage < 0.1);
  if (weak.length > 0) {
    notes.push(`${count(weak.length, 'image')}, e.g. ${weak[0].name}, ` +
      `${weak.length === 1 ? 'has' : 'have'} points in less than a tenth of the ` +
      'picture: the pose may be weak.');
  }
  return card('look', 'Worth a look', notes.length === 0 ?
    element('p', {class: 'fine'}, 'Nothing unusual was found.') :
    element('ul', {class: 'notes'}, notes.map((note) => element('li', {}, note))));
}

// ----- Missing images

function missingSection(data) {
  if (data.missing.length === 0) return null;
  const byReason = new Map();
  for (const image of data.missing) {
    const reason = image.reason || 'unknown';
    byReason.set(reason, [...(byReason.get(reason) || []), image]);
  }
  const groups = [...byReason].sort((a, b) => b[1].length - a[1].length);
  const shown = groups.slice(0, 40);
  return card('missing', 'Missing images',
    element('ul', {class: 'missing-groups'}, shown.map(([reason, images]) =>
      element('li', {},
        element('div', {class: 'missing-images'}, images.slice(0, 6).map((image) =>
          element('figure', {}, thumbnailOf(image),
            element('figcaption', {}, image.name)))),
        images.length > 6 && help('and ' + images.slice(6, 200)
          .map((image) => image.name).join(', ') +
          (images.length > 200 ? ` and ${images.length - 200} more` : '')),
        element('p', {}, element('strong', {}, 'Why: '), reasonWords(reason)),
        element('p', {}, element('strong', {}, 'What to do: '), adviceFor(reason))))),
    groups.length > shown.length &&
      help(`and ${groups.length - shown.length} more reasons, see report.json`));
}

// ----- Images

function imagesSection(data, sceneCard) {
  const registered = data.images.filter((image) => image.model !== undefined);
  if (registered.length === 0) return null;
  const table = new LongTable('Registered images', [
    {title: 'Image', key: (image) => image.name,
      text: (image) => imageButton(image, sceneCard)},
    ...(data.models.length > 1 ? [{title: 'Model', isNumber: true,
      key: (image) => image.model,
      text: (image) => data.models[image.model].name}] : []),
    {title: 'Points', isNumber: true, key: (image) => image.num_points,
      text: (image) => plainNumber(image.num_points)},
    {title: 'Coverage', isNumber: true, key: (image) => image.coverage,
      text: (image) => percent(image.coverage)},
    {title: 'Median error', isNumber: true, key: (image) => image.median_error_px,
      text: (image) => figure(image.median_error_px, 'px')},
    {title: 'Depth scale', isNumber: true, key: (image) => image.depth_scale,
      text: (image) => figure(image.depth_scale)},
  ], registered, (image) => image.name);
  return card('images', 'Images', table.node);
}

// ----- View graph

const DEGENERACIES = {
  planar: 'see one plane only', rotation_only: 'show a rotation only',
  stationary: 'do not move', weak_focal1: 'leave the first focal length open',
  weak_focal2: 'leave the second focal length open',
};

function degeneracyNote(report) {
  const found = Object.entries(report && report.degenerate_valid_pairs || {});
  return found.length > 0 && help('Of the valid pairs ' + found.map(([name, number]) =>
    `${plainNumber(number)} ${DEGENERACIES[name] || spaced(name)}`).join(', ') + '.');
}

function viewGraphSection(data) {
  if (data.pairs.count === 0) return null;
  const matrix = new PairMatrix(data);
  const table = plainTable('Pairs by status', [
    {title: 'Status', text: ({name}) =>
      [chip(statusWords(name).color), statusWords(name).label]},
    {title: 'Pairs', isNumber: true, text: ({number}) => plainNumber(number)},
    {title: 'Meaning', text: ({name}) => statusWords(name).meaning},
  ], data.pairs.counts);
  return card('pairs', 'View graph',
    element('p', {class: 'help', id: 'matrix-help'},
      'Images by images, in the order of their names' +
      (matrix.imagesPerCell > 1 ?
        `; a cell joins ${matrix.imagesPerCell} images and shows their best pair` :
        '') + '. Empty cells had no matches.'),
    element('div', {class: 'matrix-layout'},
      element('div', {}, matrix.canvas, matrix.readout),
      element('div', {}, table, degeneracyNote(data.report))));
}

// ----- Cameras

// A guess of the database says nothing, and would flatten the plot.
const MAX_PRIOR_STDDEV_RATIO = 0.15;

function focalDots(camera) {
  const dots = [];
  const name = `Camera ${camera.camera_id}, ${camera.model}`;
  const stddev = camera.prior_stddevs ? camera.prior_stddevs[0] : null;
  if (stddev !== null && stddev < MAX_PRIOR_STDDEV_RATIO * camera.prior[0]) {
    dots.push({
      value: camera.prior[0], stddev, isHollow: true,
      title: `${name}, given: ${figure(camera.prior[0], 'px')} ± ${figure(stddev)}`,
    });
  }
  const error = camera.posterior_stddevs ? camera.posterior_stddevs[0] : 0;
  dots.push({
    value: camera.posterior[0], stddev: error || 0,
    title: `${name}: ${figure(camera.posterior[0], 'px')} ± ${figure(error)}`,
  });
  return dots;
}

function camerasSection(data) {
  const cameras = (data.report && data.report.cameras || [])
    .filter((camera) => camera.posterior)
    .sort((a, b) => a.group - b.group || a.camera_id - b.camera_id);
  if (cameras.length === 0) return null;
  const shown = cameras.slice(0, 500);
  const bands = [];
  shown.forEach((camera, i) => {
    const last = bands[bands.length - 1];
    if (last && last.group === camera.group) {
      last.to = i;
    } else {
      bands.push({group: camera.group, from: i, to: i, label: `group ${camera.group}`});
    }
  });
  const focals = cameras.map((camera) => camera.posterior[0]);
  const label = `Focal lengths of ${count(cameras.length, 'camera')} in ` +
    `${count(bands.length, 'group')}, ${figure(Math.min(...focals))} to ` +
    `${figure(Math.max(...focals), 'px')}`;
  const pair = (values, stddevs, i) => stddevs && stddevs[i] !== null && stddevs[i] > 0 ?
    `${figure(values[i])} ± ${figure(stddevs[i])}` : figure(values[i]);
  return card('cameras', 'Focal lengths',
    dotPlot(label, {
      columns: shown.map(focalDots), bands, isLog: false,
      xTitle: 'cameras, by group of the same intrinsics', yTitle: 'focal length [px]',
    }),
    help('Filled: as estimated, with one standard deviation. Hollow: as given, ' +
      'where something is.',
      cameras.length > shown.length && ` The first ${shown.length} cameras are drawn.`),
    element('details', {}, element('summary', {}, 'As a table'),
      plainTable('Cameras', [
        {title: 'Camera', isNumber: true, text: (camera) => String(camera.camera_id)},
        {title: 'Group', isNumber: true, text: (camera) => String(camera.group)},
        {title: 'Model', text: (camera) => camera.model},
        {title: 'Belief', text: (camera) => spaced(camera.intrinsics_prior || '')},
        {title: 'Given [px]', isNumber: true,
          text: (camera) => pair(camera.prior || [], camera.prior_stddevs, 0)},
        {title: 'Estimated [px]', isNumber: true,
          text: (camera) => pair(camera.posterior, camera.posterior_stddevs, 0)},
      ], cameras.slice(0, 1000))));
}

// ----- Depth scales

function depthSection(data, sceneCard) {
  const images = data.images.filter((image) => image.depth_scale > 0);
  if (images.length === 0) return null;
  const step = Math.ceil(images.length / 1500);
  const shown = images.filter((image, i) => i % step === 0);
  const scales = images.map((image) => image.depth_scale);
  const middle = median(scales);
  const label = `Depth scales of ${count(images.length, 'image')}, ` +
    `${figure(Math.min(...scales))} to ${figure(Math.max(...scales))}, median ` +
    figure(middle);
  return card('depth', 'Depth scales',
    dotPlot(label, {
      columns: shown.map((image) => [{
        value: image.depth_scale, stddev: 0,
        title: `${image.name}: ${figure(image.depth_scale)}`,
        onSelect: image.model === undefined ? null : () => sceneCard.reveal(image),
      }]),
      isLog: true, guides: [{value: middle, label: `median ${figure(middle)}`}],
      xTitle: 'images, in the order of their names', yTitle: 'factor of the map',
    }),
    help('The factor by which each depth map has to be multiplied to agree with ' +
      'the model. Far from the others: the map of that image is off.',
    step > 1 && ` Every ${step}th image is drawn.`));
}

// ----- Accuracy

function sumOf(histograms) {
  return histograms[0].map((_, i) =>
    histograms.reduce((sum, histogram) => sum + histogram[i], 0));
}

function residualSection(data) {
  if (data.models.length === 0) return null;
  const [largest] = data.models;
  const counts = sumOf(data.models.map((model) => model.error_histogram));
  return card('residuals', 'Reprojection errors',
    histogram(`Histogram of reprojection errors, median ${figure(largest.median_error_px, 'px')}`, {
      counts, step: largest.error_step_px,
      xTitle: 'reprojection error [px]', yTitle: 'observations',
      marker: {
        value: largest.median_error_px,
        label: `median ${figure(largest.median_error_px, 'px')}`,
      },
    }));
}

function trackSection(data) {
  if (data.models.length === 0) return null;
  return card('tracks', 'Images per point', histogram(
    'Histogram of the number of images that see a point', {
      counts: sumOf(data.models.map((model) => model.track_histogram)), step: 1,
      xTitle: 'images that see a point', yTitle: 'points',
    }));
}

function coverageSection(data) {
  const registered = data.images.filter((image) => image.model !== undefined);
  if (registered.length === 0) return null;
  const counts = new Array(10).fill(0);
  for (const image of registered) {
    ++counts[Math.min(9, Math.floor(10 * image.coverage + 1e-9))];
  }
  const middle = median(registered.map((image) => image.coverage));
  return card('coverage', 'Coverage', histogram(
    `Histogram of the coverage of images, median ${percent(middle)}`, {
      counts, step: 10, xTitle: 'part of the picture with points [%]',
      yTitle: 'images', isWhole: true,
    }), help('Of a grid of 10 x 10 cells those with a point in them.'));
}

// ----- Time, memory, options

function stagesSection(data) {
  const stages = data.report && data.report.stages || [];
  if (stages.length === 0) return null;
  const longest = Math.max(...stages.map((stage) => stage.seconds), 1e-9);
  const known = ['stage', 'seconds', 'cpu_seconds', 'peak_memory_mb'];
  const figures = (stage) => Object.entries(stage)
    .filter(([name]) => !known.includes(name))
    .map(([name, value]) => `${spaced(name)} ${figure(value)}`).join(', ');
  return card('stages', 'Stages, time and memory', plainTable('Stages', [
    {title: 'Stage', text: (stage) => spaced(stage.stage)},
    {title: 'Time', isNumber: true, text: (stage) => seconds(stage.seconds)},
    {title: '', text: (stage) => element('span', {
      class: 'meter', 'aria-hidden': 'true',
      style: `--share: ${stage.seconds / longest}`,
    })},
    {title: 'CPU', isNumber: true, text: (stage) => seconds(stage.cpu_seconds)},
    {title: 'Peak memory', isNumber: true,
      text: (stage) => figure(stage.peak_memory_mb, 'MB')},
    {title: 'What came out', text: (stage) =>
      element('span', {class: 'small'}, figures(stage))},
  ], stages));
}

function optionsSection(data) {
  if (data.options.length === 0) return null;
  const isChanged = ({value, default: usual}) => usual !== undefined && value !== usual;
  const changed = data.options.filter(isChanged);
  const columns = [
    {title: 'Option', text: (option) => element('code', {}, option.name)},
    {title: 'Value', text: (option) => element('code', {}, option.value)},
    {title: 'Default', text: (option) => option.default === undefined ? '-' :
      element('code', {}, option.default)},
  ];
  return card('options', 'Options',
    plainTable('Options that differ from their defaults', columns, changed),
    element('details', {}, element('summary', {}, `All ${data.options.length} options`),
      plainTable('All options', columns, data.options)));
}
