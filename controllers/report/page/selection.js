// The card of the 3D view: what is shown, and the image or point that is picked.

const MAX_VIEWS_OF_POINT = 24;

// A list of terms and their values.
function factList(facts) {
  return element('dl', {class: 'facts'}, facts
    .filter(([, value]) => value !== null)
    .map(([term, value]) => [element('dt', {}, term), element('dd', {}, value)]));
}

class SceneCard {
  constructor(data) {
    this.data = data;
    this.model = data.models[0];
    this.details = element('div', {
      class: 'details', role: 'status', 'aria-label': 'Selection',
    });
    this.canvas = element('canvas', {
      id: 'scene', tabindex: 0, role: 'application',
      'aria-label': '3D view of points and cameras',
      'aria-describedby': 'scene-help',
      onkeydown: (event) => this.onKey(event),
    });
    this.imageChoice = element('select', {
      id: 'image-choice', onchange: () => {
        const index = this.imageChoice.value;
        this.select(index === '' ? null : {image: this.data.images[Number(index)]});
      },
    });
    this.body = element('div', {class: 'scene-layout'},
      element('div', {}, element('div', {class: 'scene-frame'}, this.canvas),
        element('p', {class: 'help', id: 'scene-help'},
          'Drag to turn, right-drag to move, wheel to zoom after a click. Click ' +
          'a camera or a point. Keys: arrows turn, with Shift they move, + and ' +
          '- zoom, N and P step through images, 0 resets.')),
      element('div', {class: 'scene-side'}, this.controls(), this.details));
  }

  // After the card is in the page: the view needs its size.
  start() {
    const context = this.canvas.getContext('webgl2', {antialias: true});
    if (context) {
      this.view = new SceneView(this.canvas, context,
        (picked) => this.select(picked));
    } else {
      replaceChildren(this.canvas.parentElement, element('p', {class: 'notice'},
        'This browser has no WebGL, which the 3D view needs. All else on this ' +
        'page works without.'));
    }
    this.showModel(0);
  }

  showModel(index) {
    this.model = this.data.models[index];
    replaceChildren(this.imageChoice, element('option', {value: ''}, 'none'),
      this.model.images.map((image) =>
        element('option', {value: image.index}, image.name)));
    if (this.view) {
      this.view.show(this.model, this.data.pairs, this.data.images);
    }
    for (const box of this.body.querySelectorAll('.pair-choice input')) {
      if (this.view && box.checked) this.view.showPairs(Number(box.value), true);
    }
    this.select(null);
  }

  controls() {
    const {models, pairs} = this.data;
    return element('div', {class: 'scene-controls'},
      models.length > 1 && element('label', {}, 'Model ',
        element('select', {
          id: 'model-choice',
          onchange: (event) => this.showModel(Number(event.target.value)),
        }, models.map((model, i) => element('option', {value: i},
          `${model.name}: ${count(model.num_images, 'image')}`)))),
      element('label', {}, 'Image ', this.imageChoice),
      pairs.count > 0 && element('fieldset', {class: 'pair-choice'},
        element('legend', {}, 'Pairs as lines'),
        pairs.counts.map(({index, name, number}) => element('label', {
          title: statusWords(name).meaning,
        }, element('input', {
          type: 'checkbox', value: index,
          onchange: (event) => this.view &&
            this.view.showPairs(index, event.target.checked),
        }), chip(statusWords(name).color), statusWords(name).label,
        element('span', {class: 'number'}, plainNumber(number))))));
  }

  onKey(event) {
    if (!this.view || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = 0.12;
    const arrows = {
      ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
    };
    if (arrows[event.key]) {
      const [x, y] = arrows[event.key];
      if (event.shiftKey) {
        this.view.shift(0.5 * step * x, 0.5 * step * y);
      } else {
        this.view.turn(-step * x, step * y);
      }
    } else if (event.key === '+' || event.key === '=') {
      this.view.zoom(1 / 1.15);
    } else if (event.key === '-') {
      this.view.zoom(1.15);
    } else if (event.key === '0') {
      this.view.resetView();
    } else if (event.key === 'n' || event.key === 'p') {
      this.step(event.key === 'n' ? 1 : -1);
    } else if (event.key === 'Escape') {
      this.select(null);
    } else {
      return;
    }
    event.preventDefault();
  }

  step(by) {
    const {images} = this.model;
    if (images.length === 0) return;
    const at = images.findIndex((image) => String(image.index) === this.imageChoice.value);
    const next = at < 0 ? (by > 0 ? 0 : images.length - 1) :
      (at + by + images.length) % images.length;
    this.select({image: images[next]});
  }

  // Selects an image of any model and brings the view into sight.
  reveal(image) {
    if (image.model !== this.model.index) {
      const choice = this.body.querySelector('#model-choice');
      if (choice) choice.value = image.model;
      this.showModel(image.model);
    }
    this.select({image});
    this.body.scrollIntoView({block: 'center'});
    this.canvas.focus({preventScroll: true});
  }

  select(picked) {
    const image = picked && picked.image;
    this.imageChoice.value = image ? image.index : '';
    if (image) {
      replaceChildren(this.details, this.imageDetails(image));
      if (this.view) this.view.selectImage(image);
    } else if (picked) {
      replaceChildren(this.details, this.pointDetails(picked.point));
      if (this.view) this.view.selectPoint(picked.point);
    } else {
      replaceChildren(this.details, this.modelDetails());
      if (this.view) this.view.selectNothing();
    }
  }

  modelDetails() {
    const {model} = this;
    const shown = model.points.count;
    return [
      element('h3', {}, this.data.models.length > 1 ? `Model ${model.name}` : 'Model'),
      factList([
        ['Images', plainNumber(model.num_images)],
        ['Points', plainNumber(model.num_points)],
        ['Median error', figure(model.median_error_px, 'px')],
        ['Images per point', figure(model.num_observations / model.num_points)],
      ]),
      shown < model.num_points && element('p', {class: 'help'},
        `Every ${Math.round(model.num_points / shown)}th point is shown: ` +
        `${plainNumber(shown)} of ${plainNumber(model.num_points)}. All figures ` +
        'are of all points.'),
    ];
  }

  imageDetails(image) {
    const {pairs} = this.data;
    const found = pairsOfImage(pairs, image.index);
    const valid = found.filter((pair) =>
      pairs.statusNames[pairs.statuses[pair]] === 'valid').length;
    const camera = cameraOfImage(this.model, image);
    return [
      element('h3', {class: 'name'}, image.name),
      thumbnailOf(image, 'large'),
      factList([
        ['Status', 'registered'],
        ['Points', plainNumber(image.num_points)],
        ['Coverage', percent(image.coverage)],
        ['Median error', figure(image.median_error_px, 'px')],
        ['Depth scale', image.depth_scale === undefined ? 'no depth map used' :
          figure(image.depth_scale)],
        ['Camera', `${image.camera_id}, ${figure(camera.params[0], 'px')}`],
        ['Pairs', this.data.report ? `${valid} valid of ${found.length}` : null],
      ]),
    ];
  }

  pointDetails(index) {
    const {starts, viewImages, viewPositions, positions} = this.model.points;
    const views = [];
    for (let i = starts[index]; i < starts[index + 1]; ++i) {
      views.push({
        image: this.data.images[viewImages[i]],
        x: viewPositions[2 * i] / 255, y: viewPositions[2 * i + 1] / 255,
      });
    }
    return [
      element('h3', {}, 'Point'),
      factList([
        ['Track', count(views.length, 'image')],
        ['Position', Array.from(positions.slice(3 * index, 3 * index + 3),
          (value) => figure(value)).join(', ')],
      ]),
      element('ul', {class: 'views'}, views.slice(0, MAX_VIEWS_OF_POINT).map((view) =>
        element('li', {}, element('button', {
          type: 'button', onclick: () => this.select({image: view.image}),
        }, element('span', {class: 'view-picture'}, thumbnailOf(view.image),
          view.image.thumbnail && element('span', {
            class: 'cross', style: `left: ${100 * view.x}%; top: ${100 * view.y}%`,
          })), element('span', {class: 'view-name'}, view.image.name))))),
      views.length > MAX_VIEWS_OF_POINT && element('p', {class: 'help'},
        `and ${views.length - MAX_VIEWS_OF_POINT} more`),
    ];
  }
}
