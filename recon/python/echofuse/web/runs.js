// SPDX-License-Identifier: MIT
// Shows the runs in a folder. Each run has a card that links to the page of the run.

const $ = id => document.getElementById(id);
const side = 112, pause = {all: 5000, more: 100};
let listed = '';  // displayed list of runs, as JSON

function thumbnail(run, span) {
  const canvas = document.createElement('canvas'), c = canvas.getContext('2d'), high = side * devicePixelRatio;
  canvas.width = canvas.height = high;
  canvas.role = 'img', canvas.ariaLabel = run.map ? 'depth map of the middle record' : run.histogram ? 'histogram of the middle record' : 'no record';
  if (run.map) {
    const rows = Math.sqrt(run.map.length);
    fill(canvas, picture(run.map, rows, rows, span, tables.near, 0.01));
  } else if (run.histogram) {
    const most = Math.max(1, ...run.histogram), width = high / run.histogram.length;
    c.fillStyle = colour('--spd');
    run.histogram.forEach((v, i) => c.fillRect(i * width, high * (1 - v / most), width, high * v / most));
  }
  return canvas;
}
const labelsOf = ({labels}) => Object.entries(labels).filter(([name]) => name).sort((a, b) => b[1] - a[1])
  .map(([name, count]) => `${name} ${siNumber(count)}`);

function card(run, span) {
  const at = document.createElement('a'), words = document.createElement('div');
  const add = (kind, text, look = '') => text && words.append(Object.assign(document.createElement(kind), {textContent: text, className: look}));
  at.className = 'card run', at.href = `run/${encodeURIComponent(run.name)}/${location.search}`;
  add('h2', run.name);
  if (run.waits || run.fault) {
    add('p', run.fault ?? 'reading', run.fault ? 'doubts' : 'quiet');
  } else {
    const labels = labelsOf(run), shown = labels.slice(0, 4).join(', ');
    add('p', statusWord(run.status), 'status');
    words.lastChild.dataset.status = run.status.split(':')[0];
    add('p', `${run.started_utc.slice(0, 16).replace('T', ' ')} UTC, ${clock(run.length_s)}, ${run.records} records`, 'quiet');
    add('p', shown + (labels.length > 4 ? ` and ${labels.length - 4} more` : ''));
    add('p', run.verdict || 'no record is doubtful', run.verdict ? 'doubts' : 'quiet');
  }
  at.append(thumbnail(run, span), words);
  return at;
}
// Compares two runs in the chosen order.
function order(a, b) {
  const key = $('sort').value, value = run => run[key] ?? '';
  const [x, y] = key === 'name' ? [value(b), value(a)] : [value(a), value(b)];
  return x < y ? 1 : x > y ? -1 : 0;
}
function draw() {
  const runs = JSON.parse(listed), span = spanOf(runs.flatMap(run => run.map ?? []).map(cm => cm / 100));
  const words = $('search').value.toLowerCase().split(/\s+/), cards = runs.sort(order).map(run => card(run, span));
  const found = cards.filter(at => words.every(word => at.textContent.toLowerCase().includes(word)));
  $('about').textContent = !runs.length ? 'no runs in this folder yet' : found.length < runs.length ? `${found.length} of ${runs.length}` : `${runs.length}`;
  const focused = document.activeElement.href;
  $('runs-list').replaceChildren(...found);
  if (focused) found.find(at => at.href === focused)?.focus();
}
// Requests the list of runs every 5 s, or every 0.1 s until all runs have been read. Redraws only if the list has
// changed, so that cards do not move while the user clicks.
async function poll() {
  let wait = pause.all;
  try {
    const answer = document.hidden ? null : await fetch(`runs${location.search}`);
    if (answer && !answer.ok) throw Error(await refusal(answer));
    const text = await answer?.text();
    if (text?.includes('"waits":true')) wait = pause.more;
    if (text && text !== listed) listed = text, draw();
    $('trouble').hidden = true;
  } catch (error) {
    $('trouble').textContent = error instanceof TypeError ? 'no connection to the viewer' : error.message;
    $('trouble').hidden = false;
  }
  setTimeout(poll, wait);
}
for (const id of ['search', 'sort']) $(id).addEventListener('input', () => listed && draw());
$('newest').href = `newest/${location.search}`;
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => listed && draw());
poll();
