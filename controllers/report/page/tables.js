// Tables: plain ones, and one of many rows with a filter and an order.

const ROWS_AT_ONCE = 50;

function plainTable(caption, columns, rows) {
  return element('div', {class: 'table-frame', tabindex: 0, role: 'region', 'aria-label': caption},
    element('table', {},
      element('caption', {class: 'hidden'}, caption),
      element('thead', {}, element('tr', {}, columns.map((column) =>
        element('th', {scope: 'col', class: column.isNumber && 'number'}, column.title)))),
      element('tbody', {}, rows.map((row) => element('tr', {}, columns.map((column) =>
        element('td', {class: column.isNumber && 'number'}, column.text(row))))))));
}

// `columns` are {title, key, text, isNumber}: key gives what to order by, text
// the content of a cell.
class LongTable {
  constructor(caption, columns, rows, filterText) {
    this.columns = columns;
    this.rows = rows;
    this.filterText = filterText;
    this.order = {column: columns[0], isDescending: false};
    this.numShown = ROWS_AT_ONCE;
    this.filter = element('input', {
      type: 'search', 'aria-label': `Filter: ${caption}`, placeholder: 'Filter by name',
      oninput: () => {
        this.numShown = ROWS_AT_ONCE;
        this.fill();
      },
    });
    this.head = element('tr');
    this.body = element('tbody');
    this.more = element('button', {
      type: 'button', class: 'quiet', onclick: () => {
        this.numShown *= 4;
        this.fill();
      },
    });
    this.note = element('p', {class: 'help', role: 'status'});
    this.node = element('div', {},
      rows.length > 10 && this.filter,
      element('div', {class: 'table-frame', tabindex: 0, role: 'region', 'aria-label': caption},
        element('table', {}, element('caption', {class: 'hidden'}, caption),
          element('thead', {}, this.head), this.body)),
      element('div', {class: 'table-foot'}, this.note, this.more));
    this.heads = columns.map((column) => element('th', {
      scope: 'col', class: column.isNumber && 'number',
    }, element('button', {
      type: 'button', onclick: () => this.orderBy(column),
    }, column.title)));
    addTo(this.head, this.heads);
    this.fill();
  }

  orderBy(column) {
    const isSame = this.order.column === column;
    this.order = {column, isDescending: isSame && !this.order.isDescending};
    this.fill();
  }

  fill() {
    const {column, isDescending} = this.order;
    this.heads.forEach((head, i) => {
      head.setAttribute('aria-sort', this.columns[i] !== column ? 'none' :
        isDescending ? 'descending' : 'ascending');
    });
    const wanted = this.filter.value.toLowerCase();
    const found = this.rows.filter((row) =>
      this.filterText(row).toLowerCase().includes(wanted));
    const sign = isDescending ? -1 : 1;
    // What is unknown comes last.
    found.sort((a, b) => {
      const [first, second] = [column.key(a), column.key(b)];
      if (first === undefined || second === undefined) {
        return (first === undefined) - (second === undefined);
      }
      return sign * (first < second ? -1 : first > second ? 1 : 0);
    });
    const shown = found.slice(0, this.numShown);
    replaceChildren(this.body, shown.map((row) => element('tr', {},
      this.columns.map((each) => element('td', {
        class: each.isNumber && 'number',
      }, each.text(row))))));
    this.note.textContent = found.length > shown.length ?
      `${plainNumber(shown.length)} of ${plainNumber(found.length)} rows` : '';
    this.more.textContent = 'Show more';
    this.more.hidden = found.length <= shown.length;
  }
}
