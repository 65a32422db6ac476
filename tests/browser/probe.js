// What a person sees of a report, as JSON in place of the page: texts, figures, and what lies on or beyond what it should not.
const area = (a, b) => Math.max(0, Math.min(a.right, b.right) - Math.max(a.left, b.left)) * Math.max(0, Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top));
const trimmed = (box) => ({ left: box.left + 1, right: box.right - 1, top: box.top + 2, bottom: box.bottom - 2 });
const overlaps = [], outside = [];
for (const svg of document.querySelectorAll('svg')) {
  const frame = svg.getBoundingClientRect();
  const texts = [...svg.querySelectorAll('text')].map((e) => [e.textContent, trimmed(e.getBoundingClientRect())]);
  const what = svg.getAttribute('aria-label');
  texts.forEach(([name, box], k) => {
    for (const [other, its] of texts.slice(0, k)) if (area(box, its) > 1) overlaps.push(`${what}: "${name}" on "${other}"`);
    if (box.left < frame.left - 3 || box.right > frame.right + 3 || box.top < frame.top - 3 || box.bottom > frame.bottom + 3) outside.push(`${what}: "${name}"`);
  });
}
const number = (color) => color.match(/[\d.]+/g).slice(0, 3).reduce((sum, part) => sum + Number(part), 0);
const style = getComputedStyle(document.body);
const seen = {
  title: document.title,
  headings: [...document.querySelectorAll('h1, h2, h3')].map((e) => e.textContent),
  text: [...document.querySelectorAll('p, li')].map((e) => e.textContent),
  tables: [...document.querySelectorAll('table')].map((table) => ({
    caption: table.caption.textContent,
    rows: [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent)),
  })),
  figures: [...document.querySelectorAll('figure')].map((figure) => ({
    title: figure.querySelector('b').textContent,
    legend: [...figure.querySelectorAll('.legend span')].map((e) => e.textContent),
    texts: [...figure.querySelectorAll('svg text')].map((e) => e.textContent),
    bars: [...figure.querySelectorAll('rect title')].map((e) => e.textContent),
    lines: figure.querySelectorAll('path.line').length,
    // Dots are pieces without length, each begun by a move.
    dots: [...figure.querySelectorAll('path.dots')].reduce((n, path) => n + path.getAttribute('d').split('M').length - 1, 0),
    bands: figure.querySelectorAll('path.band').length,
    height: figure.querySelector('svg').getBoundingClientRect().height,
  })),
  foreign: [...document.querySelectorAll('script:not(#probe), img, iframe, link, object, embed, a')].map((e) => e.outerHTML),
  overlaps, outside,
  sideways: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  brightness: { paper: number(style.backgroundColor), ink: number(style.color) },
};
const safe = JSON.stringify(seen).replace(/[<>&\u007f-\uffff]/g, (c) => '\\u' + c.charCodeAt(0).toString(16).padStart(4, '0'));
document.body.innerHTML = '<pre id="seen">' + safe + '</pre>';
