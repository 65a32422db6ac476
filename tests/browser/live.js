// What a person sees of the live page after some seconds, as JSON at its end. The page is then a still picture of itself: no scripts, images for canvases.
setTimeout(() => {
  const color = (name) => getComputedStyle(document.body).getPropertyValue(name).trim().match(/[0-9a-f]{2}/gi).map((part) => parseInt(part, 16));
  // Columns of a canvas in which something has this color: a trace is as long as what was heard.
  const columns = (canvas, [r, g, b]) => {
    const { data, width, height } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    const is = (x, y, at = 4 * (y * width + x)) => data[at + 3] > 128 && Math.abs(data[at] - r) + Math.abs(data[at + 1] - g) + Math.abs(data[at + 2] - b) < 40;
    return [...Array(width).keys()].filter((x) => [...Array(height).keys()].some((y) => is(x, y))).length;
  };
  const text = (e) => e.textContent;
  const seen = {
    state: text(document.getElementById('state')),
    reason: text(document.getElementById('reason')),
    axes: [...document.querySelectorAll('.axis')].map((card) => ({
      name: text(card.querySelector('h2')), value: text(card.querySelector('b')), hides: text(card.querySelector('.hides')),
      trace: columns(card.querySelector('canvas'), color('--trace')),
    })),
    gauges: [...document.querySelectorAll('#gauges tr')].map((row) => [...row.cells].map(text)),
    facts: Object.fromEntries([...document.querySelectorAll('#facts dt')].map((e) => [text(e), text(e.nextElementSibling)])),
  };
  const pre = document.createElement('pre');
  pre.id = 'seen';
  pre.hidden = true;
  pre.textContent = JSON.stringify(seen).replace(/[<>&\u007f-\uffff]/g, (c) => '\\u' + c.charCodeAt(0).toString(16).padStart(4, '0'));
  document.body.append(pre);
  poll = () => {};
  for (const canvas of document.querySelectorAll('canvas')) {
    const image = document.createElement('img');
    image.src = canvas.toDataURL();
    image.style = 'grid-column: 1 / -1; width: 100%; height: 90px';
    canvas.replaceWith(image);
  }
  document.querySelectorAll('script').forEach((script) => script.remove());
}, 2500);
