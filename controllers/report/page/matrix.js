// The view graph as a matrix: a cell for each pair of images, in the order of
// their names, in the colour of its status. Of more images than pixels, cells
// join several.

const MAX_MATRIX_SIZE = 1024;
const MATRIX_WIDTH = 460;

class PairMatrix {
  constructor(data) {
    this.data = data;
    const numImages = data.images.length;
    this.imagesPerCell = Math.ceil(numImages / MAX_MATRIX_SIZE);
    this.size = Math.ceil(numImages / this.imagesPerCell);
    this.cells = this.fillCells();
    this.at = [0, 0];
    // Pixels of a cell are whole ones, on the screen too.
    this.scale = Math.max(1,
      Math.floor(MATRIX_WIDTH * devicePixelRatio / this.size));
    const width = Math.min(MATRIX_WIDTH, this.scale * this.size / devicePixelRatio);
    this.canvas = element('canvas', {
      id: 'matrix', class: 'matrix', tabindex: 0, role: 'application',
      'aria-label': 'View graph as a matrix of images by images',
      'aria-describedby': 'matrix-help',
      width: this.scale * this.size, height: this.scale * this.size,
      style: `width: ${width}px`,
      onpointermove: (event) => this.onPointer(event),
      onkeydown: (event) => this.onKey(event),
    });
    this.readout = element('p', {class: 'readout', role: 'status'},
      'Point at a cell, or move through the matrix by the arrow keys.');
    onThemeChange(() => this.draw());
    this.draw();
  }

  // For each cell the pair to show: a valid one before others, then the one
  // with most inliers.
  fillCells() {
    const {pairs} = this.data;
    const cells = new Int32Array(this.size * this.size).fill(-1);
    const rank = (pair) =>
      (pairs.statusNames[pairs.statuses[pair]] === 'valid' ? 2 ** 32 : 0) +
      pairs.numInliers[pair];
    for (let pair = 0; pair < pairs.count; ++pair) {
      const row = Math.floor(pairs.images[2 * pair] / this.imagesPerCell);
      const column = Math.floor(pairs.images[2 * pair + 1] / this.imagesPerCell);
      for (const cell of [row * this.size + column, column * this.size + row]) {
        if (cells[cell] < 0 || rank(pair) > rank(cells[cell])) cells[cell] = pair;
      }
    }
    return cells;
  }

  draw() {
    const context = this.canvas.getContext('2d');
    const {pairs} = this.data;
    const colors = pairs.statusNames.map((name) => themeColor(statusWords(name).color));
    const gap = this.scale >= 8 ? 1 : 0;
    context.fillStyle = themeColor('matrix');
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    this.cells.forEach((pair, cell) => {
      if (pair < 0) return;
      context.fillStyle = colors[pairs.statuses[pair]];
      context.fillRect(this.scale * (cell % this.size),
        this.scale * Math.floor(cell / this.size),
        this.scale - gap, this.scale - gap);
    });
    const [row, column] = this.at;
    if (document.activeElement === this.canvas) {
      context.strokeStyle = themeColor('selected');
      context.lineWidth = 2;
      context.strokeRect(this.scale * column, this.scale * row, this.scale, this.scale);
    }
  }

  onPointer(event) {
    const box = this.canvas.getBoundingClientRect();
    const cellAt = (position, length) => Math.min(this.size - 1,
      Math.max(0, Math.floor(this.size * position / length)));
    this.moveTo(cellAt(event.clientY - box.top, box.height),
      cellAt(event.clientX - box.left, box.width));
  }

  onKey(event) {
    const moves = {
      ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1],
    };
    const move = moves[event.key];
    if (!move) return;
    event.preventDefault();
    const clamp = (value) => Math.min(this.size - 1, Math.max(0, value));
    this.moveTo(clamp(this.at[0] + move[0]), clamp(this.at[1] + move[1]));
  }

  moveTo(row, column) {
    this.at = [row, column];
    this.draw();
    this.readout.textContent = this.describe(row, column);
  }

  describe(row, column) {
    const {pairs, images} = this.data;
    const pair = this.cells[row * this.size + column];
    if (pair < 0) {
      const first = images[row * this.imagesPerCell].name;
      const second = images[column * this.imagesPerCell].name;
      return first === second ? first : `${first} and ${second}: no matches`;
    }
    const first = images[pairs.images[2 * pair]].name;
    const second = images[pairs.images[2 * pair + 1]].name;
    const {label} = statusWords(pairs.statusNames[pairs.statuses[pair]]);
    return `${first} and ${second}: ${label}, ` +
      `${plainNumber(pairs.numInliers[pair])} inliers of ` +
      `${count(pairs.numMatches[pair], 'match', 'matches')}`;
  }
}
