// Elements of HTML and SVG. Text is always set as text, never as markup: names
// of images are somebody else's.

function addTo(parent, children) {
  for (const child of children.flat(Infinity)) {
    if (child === null || child === undefined || child === false) continue;
    parent.append(child);
  }
  return parent;
}

function setAttributes(node, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith('on')) {
      node.addEventListener(name.slice(2), value);
    } else {
      node.setAttribute(name, value === true ? '' : value);
    }
  }
  return node;
}

function element(tag, attributes = {}, ...children) {
  return addTo(setAttributes(document.createElement(tag), attributes), children);
}

function drawing(tag, attributes = {}, ...children) {
  const node = document.createElementNS('http://www.w3.org/2000/svg', tag);
  return addTo(setAttributes(node, attributes), children);
}

function replaceChildren(node, ...children) {
  node.replaceChildren();
  return addTo(node, children);
}

// A chip in the colour of a status.
function chip(colorName) {
  return element('span', {
    class: 'chip', 'aria-hidden': 'true', style: `--chip: var(--${colorName})`,
  });
}

// The value of a colour of the style sheet as it is now, light or dark.
function themeColor(name) {
  return getComputedStyle(document.documentElement)
    .getPropertyValue('--' + name).trim();
}

function onThemeChange(callback) {
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', callback);
}

function thumbnailOf(image, className = '') {
  if (!image.thumbnail) return null;
  return element('img', {
    class: className, alt: `Thumbnail of ${image.name}`, decoding: 'async',
    src: 'data:image/jpeg;base64,' + image.thumbnail,
  });
}
