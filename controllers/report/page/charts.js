// Charts as SVG: a histogram and a plot of dots with error bars. Each has a
// sentence for those who do not see it.

const MARGINS = {left: 52, right: 12, top: 30, bottom: 40};
const WIDE = {...MARGINS, width: 580, height: 240};
const NARROW = {...MARGINS, width: 380, height: 240};

function niceStep(range, maxTicks) {
  const rough = range / maxTicks;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
}

function linearTicks(low, high, maxTicks) {
  const step = niceStep(high - low, maxTicks);
  const ticks = [];
  for (let i = Math.ceil(low / step); i * step <= high * (1 + 1e-9); ++i) {
    ticks.push(i * step);
  }
  return ticks;
}

// Powers of ten with 2 and 5 between, if these are at least two.
function logTicks(low, high) {
  const ticks = [];
  for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; ++power) {
    for (const factor of [1, 2, 5]) {
      const tick = factor * 10 ** power;
      if (tick >= low && tick <= high) ticks.push(tick);
    }
  }
  return ticks.length >= 2 ? ticks : linearTicks(low, high, 5);
}

// Maps values of [low, high] to pixels of the chart.
function axis(low, high, from, to, isLog = false) {
  const map = isLog ? Math.log : (value) => value;
  const span = map(high) - map(low);
  return (value) => from + (to - from) * (map(value) - map(low)) / span;
}

function chartFrame(label, shape, {xTitle, yTitle, yTicks, y}) {
  const {width, height, left, right} = shape;
  const root = drawing('svg', {
    class: 'chart', role: 'img', 'aria-label': label,
    viewBox: `0 0 ${width} ${height}`,
  });
  for (const tick of yTicks) {
    const at = y(tick);
    addTo(root, [
      drawing('line', {class: 'grid', x1: left, x2: width - right, y1: at, y2: at}),
      drawing('text', {class: 'tick', x: left - 8, y: at + 4, 'text-anchor': 'end'},
        plainNumber(tick)),
    ]);
  }
  addTo(root, [
    drawing('text', {
      class: 'axis-title', x: (left + width - right) / 2, y: height - 4,
      'text-anchor': 'middle',
    }, xTitle),
    drawing('text', {class: 'axis-title', x: 0, y: 12}, yTitle),
  ]);
  return root;
}

function plainNumber(value) {
  return value.toLocaleString('en', {maximumFractionDigits: 6});
}

// `counts[i]` are for values from i * step on; the last one is for all larger
// ones unless isWhole. `marker` is {value, label}.
function histogram(label, {counts, step, xTitle, yTitle, marker, isWhole}) {
  const {width, height, left, right, top, bottom} = NARROW;
  const highest = Math.max(1, ...counts);
  const y = axis(0, highest, height - bottom, top);
  const x = axis(0, counts.length, left, width - right);
  const root = chartFrame(label, NARROW, {
    xTitle, yTitle, y,
    yTicks: linearTicks(0, highest, 4).filter(Number.isInteger),
  });
  counts.forEach((number, i) => {
    const isLast = !isWhole && i + 1 === counts.length;
    const range = isLast ? `${plainNumber(i * step)} and more` :
      step === 1 ? plainNumber(i) :
        `${plainNumber(i * step)} to ${plainNumber((i + 1) * step)}`;
    addTo(root, [drawing('rect', {
      class: isLast ? 'bar rest' : 'bar', x: x(i) + 0.5, y: y(number),
      width: x(1) - x(0) - 1, height: y(0) - y(number),
    }, drawing('title', {}, `${range}: ${plainNumber(number)}`))]);
  });
  const tickStep = niceStep(counts.length * step, 6);
  for (let value = 0; value <= (counts.length - (isWhole ? 0 : 1)) * step + 1e-9;
    value += tickStep) {
    // Whole numbers have bars, ranges have borders.
    const at = x(value / step + (step === 1 ? 0.5 : 0));
    addTo(root, [drawing('text', {
      class: 'tick', x: at, y: height - bottom + 16, 'text-anchor': 'middle',
    }, plainNumber(value))]);
  }
  if (marker && Number.isFinite(marker.value)) {
    const at = x(Math.min(marker.value / step, counts.length));
    const isRight = at > width / 2;
    addTo(root, [
      drawing('line', {class: 'marker', x1: at, x2: at, y1: top, y2: y(0)}),
      drawing('text', {
        class: 'marker-label', x: at + (isRight ? -6 : 6), y: top + 10,
        'text-anchor': isRight ? 'end' : 'start',
      }, marker.label),
    ]);
  }
  return root;
}

// Range of values with some room; for a single value some of it.
function roomyRange(values, isLog) {
  let low = Math.min(...values);
  let high = Math.max(...values);
  if (isLog) {
    const room = Math.max(1.02, (high / low) ** 0.08);
    return [low / room, high * room];
  }
  const room = Math.max(0.08 * (high - low), 0.005 * Math.abs(high), 1e-9);
  low -= room;
  high += room;
  return [low, high];
}

// One dot of the plot with its error bar. `dot` is {value, stddev, title,
// isHollow, onSelect}, both with a standard deviation of 0 where it is unknown.
function plotDot(dot, at, y, [low, high]) {
  const clamp = (value) => Math.min(high, Math.max(low, value));
  const isLinked = Boolean(dot.onSelect);
  const group = drawing('g', {
    class: 'dot' + (dot.isHollow ? ' hollow' : '') + (isLinked ? ' linked' : ''),
    onclick: dot.onSelect || null,
  }, drawing('title', {}, dot.title));
  if (dot.stddev > 0) {
    addTo(group, [drawing('line', {
      x1: at, x2: at,
      y1: y(clamp(dot.value - dot.stddev)), y2: y(clamp(dot.value + dot.stddev)),
    })]);
  }
  return addTo(group, [
    drawing('circle', {cx: at, cy: y(clamp(dot.value)), r: dot.isHollow ? 3.5 : 3}),
  ]);
}

// Columns of dots; `bands` are {from, to, label} of columns that belong
// together, `guides` {value, label}.
function dotPlot(label, {columns, xTitle, yTitle, isLog, bands = [], guides = []}) {
  const {width, height, left, right, top, bottom} = WIDE;
  const values = columns.flat().flatMap((dot) => {
    // Wide priors must not flatten the rest.
    const isNarrow = dot.stddev > 0 && dot.stddev < 0.15 * dot.value;
    return isNarrow && !isLog ?
      [dot.value - dot.stddev, dot.value + dot.stddev] : [dot.value];
  });
  for (const guide of guides) values.push(guide.value);
  const range = roomyRange(values, isLog);
  const y = axis(...range, height - bottom, top, isLog);
  const x = axis(-0.5, columns.length - 0.5, left, width - right);
  const root = chartFrame(label, WIDE, {
    xTitle, yTitle, y,
    yTicks: isLog ? logTicks(...range) : linearTicks(...range, 4),
  });
  bands.forEach((band, i) => {
    const from = x(band.from - 0.5);
    const bandWidth = x(band.to + 0.5) - from;
    if (i % 2 === 1) {
      root.prepend(drawing('rect', {
        class: 'band', x: from, y: top, width: bandWidth,
        height: height - top - bottom,
      }));
    }
    if (bandWidth > 9 * band.label.length) {
      addTo(root, [drawing('text', {
        class: 'tick', x: from + bandWidth / 2, y: height - bottom + 16,
        'text-anchor': 'middle',
      }, band.label)]);
    }
  });
  for (const guide of guides) {
    const at = y(guide.value);
    addTo(root, [
      drawing('line', {class: 'marker', x1: left, x2: width - right, y1: at, y2: at}),
      drawing('text', {
        class: 'marker-label', x: width - right, y: at - 5, 'text-anchor': 'end',
      }, guide.label),
    ]);
  }
  columns.forEach((dots, i) => {
    for (const dot of dots) addTo(root, [plotDot(dot, x(i), y, range)]);
  });
  return root;
}
