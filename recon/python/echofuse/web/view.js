// SPDX-License-Identifier: MIT
// Page of a run. Displays the data in messages from the server, and sends requests when a key or a button is pressed.
'use strict';
const $ = id => document.getElementById(id);
const sensors = ['spd', 'radar', 'depth'];
const histogram = new Histogram(), profile = new Profile(), strips = new Strips(), curves = {radar_c: new Curve('strip-temperature'), margin_ms: new Curve('strip-margin')}, cloud = new Cloud();
const waterfalls = {spd: new Waterfall('waterfall-spd'), radar: new Waterfall('waterfall-radar')};
const plan = new Plan();
histogram.partner = profile, profile.partner = histogram;
const views = {map: new MapView('map'), camera: new MapView('camera'), reconstruction: new MapView('reconstruction'),
               deviation: new MapView('deviation', 'sure')};
// newestWith: index of the newest record that had data, for each view.
const alarm = new Alarm('sound'), zones = new Zones(), newestWith = {};
const sheet = new Sheet(index => show(index));
let run = null, state = null, record = null, sum = null, strip = null, span = [2.5, 5], spanKnown = false;
let wasLive = false, received = 0, lastMessage = performance.now(), connected = false, live = true, wanted = null, cloudOf = 'map', sheetAt = -1;
window.framesSeen = 0;
// The viewer sends a message at least every second. It is considered unreachable if no message arrives for 3 s.
const file = !!$('messages');  // true: the page has been saved by echofuse-view --save
const silence = () => (performance.now() - lastMessage) / 1000, reached = () => connected && (file || silence() < 3);

const age = s => s < 10 ? `${s.toFixed(1)} s ago` : s < 600 ? `${Math.round(s)} s ago` : `${clock(s)} ago`;
const count = n => n >= 1e6 ? `${(n / 1e6).toPrecision(4)} M` : n >= 1e4 ? `${(n / 1e3).toPrecision(4)} k` : `${n}`;
const shortTime = s => s < 1e-3 ? `${+(s * 1e6).toPrecision(3)} µs` : s < 1 ? `${+(s * 1e3).toPrecision(3)} ms` : `${+s.toPrecision(3)} s`;
const bytes = n => n >= 1e9 ? `${(n / 1e9).toFixed(n < 1e10 ? 1 : 0)} GB` : `${(n / 1e6).toPrecision(3)} MB`;
const names = {spd: 'SPD', radar: 'radar', depth: 'depth camera'};
const setText = (id, text) => {
  if ($(id).textContent !== text) $(id).textContent = text;
};

const faultOf = made => made.fault.replace(/\bspd\b/, names.spd);
const unitOf = (name, n) => name === 'spd' ? 'clicks' : n === 1 ? 'frame' : 'frames';
const rate = (n, name) => `${n < 10 ? +n.toPrecision(2) : count(Math.round(n))} ${unitOf(name)}/s`;

const doubtsOf = shown => sensors.filter(name => shown.sensors[name].doubtful)
  .map(name => `${names[name]}: ${shown.sensors[name].verdict}`);
// Returns the colour and the word of a sensor's status indicator. The word is sufficient if the colours cannot be
// distinguished.
function lampOf(sensor, over) {
  if (!sensor.configured) return ['off', 'OFF'];
  if (!over && sensor.stale) return ['bad', 'LOST'];
  if (!sensor.valid) return over ? ['bad', 'LOST'] : ['look', 'CHECK'];
  return {ok: ['ok', 'OK'], neutral: ['off', 'N/A']}[sensor.lamp] ?? ['look', 'CHECK'];
}
function light(name, [lamp, word], verdict, note) {
  const at = $(`lamp-${name}`);
  at.dataset.lamp = lamp;
  at.classList.toggle('long', word.length > 6);
  for (const [part, text] of [['strong', word], ['.verdict', verdict], ['.age', note]]) {
    const box = at.querySelector(part);
    if (box.textContent !== text) box.textContent = text;
  }
  at.title = [verdict, note].filter(Boolean).join('; ');
}
function drawLamps() {
  if (!state || !run) return;
  const old = (performance.now() - received) / 1000, over = state.status !== 'open' || file, lost = [], look = [];
  for (const name of sensors) {
    const {worst, configured} = state.sensors[name], shown = !live && record?.sensors[name];
    if (over && !shown) {  // shows the verdict on the whole run
      light(name, !configured ? ['off', 'OFF'] : !worst ? ['ok', 'OK'] : worst.valid ? ['look', 'CHECK'] : ['bad', 'LOST'],
            !configured ? 'not configured' : worst ? `${worst.word} in ${worst.records} of ${state.records} records` : `good in all ${state.records} records`,
            worst ? `last at ${timeOf(worst.utc)} UTC, record ${worst.index}` : '');
      continue;
    }
    const sensor = {...state.sensors[name], ...shown};
    const lamp = !reached() ? ['off', '?'] : lampOf(sensor, shown);
    if (lamp[1] === 'LOST') lost.push(name);
    if (lamp[1] === 'CHECK') look.push(name);
    light(name, lamp, !reached() ? 'no connection' : !sensor.configured ? 'not configured'
            : lamp[1] === 'LOST' && sensor.valid ? 'no new record' : sensor.verdict !== 'ok' ? sensor.verdict
            : shown ? `${count(sensor.used)} ${unitOf(name, sensor.used)}`
            : sensor.arrived > sensor.used ? `${rate(sensor.arrived / run.window_s, name)}, ${sensor.used} used` : rate(sensor.used / run.window_s, name),
          !sensor.configured ? '' : shown ? `in record ${record.index}` : sensor.age_s == null ? 'no data yet' : `last data ${age(sensor.age_s + old)}`);
  }
  drawStatus(over || !live ? [] : lost, over || !live ? [] : look);
  drawDoubts();
  drawMapsLamp();
}
// Shows the number of doubtful records and the time of the last one. The user can acknowledge them; the line is then
// quiet until another record is doubtful.
const known = () => `acknowledged ${run.uuid}`;
// A browser that blocks cookies also blocks localStorage.
const storage = (() => { try { return localStorage; } catch { return {}; } })();
function drawDoubts() {
  const {doubtful, doubts, last_doubt: last} = state, quiet = !file && doubtful <= +storage[known()];
  setText('doubts-text', !last ? 'no record is doubtful'
    : doubts.replace(':', `, last at ${timeOf(last.utc)} UTC (record ${last.index})${quiet ? ', acknowledged' : ''}:`));
  $('doubts').title = $('doubts-text').textContent;
  $('doubts').hidden = false, $('doubts').dataset.none = !doubtful || quiet;
  $('acknowledge').hidden = !doubtful || quiet || file;
}
// Omits the date of times on the day of the newest message.
const timeOf = (utc, end = 19) => utc.slice(state?.utc.startsWith(utc.slice(0, 10)) ? 11 : 0, end).replace('T', ' ');
// Returns e.g. "stopped: disk full at 03:12:05 UTC".
const endOf = ({status, ended_utc: ended}) => statusWord(status) + (ended ? ` at ${timeOf(ended)} UTC` : '');
// Shows the most serious state of the run and its sensors.
function drawStatus(lost, look) {
  const of = list => list.map(name => names[name]).join(', ');
  const all = sensors.filter(name => state.sensors[name].configured);
  const full = state.alerts.some(alert => alert.source === 'disk');
  const text = !reached() ? `no connection to the viewer for ${Math.round(silence())} s` : lost.length === all.length && lost.length ? 'NO DATA from any sensor'
    : lost.length ? `recording without ${of(lost)}` : look.length ? `recording; check ${of(look)}` : full ? 'recording; disk nearly full' : state.status !== 'open' ? endOf(state) : file ? 'recording when saved' : 'recording';
  setText('status', text);
  $('status').dataset.status = !reached() || lost.length ? 'lost' : look.length || full ? 'look' : state.status.split(':')[0];
}
// Shows whether the reconstruction of the record is reliable.
function drawMapsLamp() {
  $('lamp-maps').hidden = !run.model;
  const made = record?.reconstruction;
  if (!reached()) return light('maps', ['off', '?'], 'no connection', '');
  if (!made) return light('maps', ['off', '–'], run.model ? 'none yet' : '', '');
  const met = made.iou == null ? '' : `IoU ${made.iou.toFixed(2)}` +
    (made.lateral_error_m == null ? '' : `, lateral error ${(made.lateral_error_m * 100).toFixed(0)}\u00a0cm`);
  const why = faultOf(made) || [...doubtsOf(record), made.note, state?.doubt && 'run differs from the training data'].filter(Boolean).join('; ');
  light('maps', made.fault ? ['bad', 'NONE'] : made.seen ? ['look', 'TRAINED ON THIS RECORD'] : !run.calibrated ? ['look', 'NOT CALIBRATED'] : why ? ['look', 'DOUBT'] : ['ok', 'OK'],
        [why, made.x_m == null ? made.fault ? '' : 'no body in the reconstruction' : `x\u00a0${made.x_m.toFixed(2)}\u00a0m` + (made.lateral_interval_90_m == null ? '' :
          ` ±${(made.lateral_interval_90_m * 100).toFixed(0)}\u00a0cm (90\u00a0%)`) + `, z\u00a0${made.z_m.toFixed(2)}\u00a0m`].filter(Boolean).join('; '), met);
}

function drawNumbers() {
  const s = state;
  setText('live', s.status === 'open' ? 'live' : 'newest');
  setText('records', s.planned ? `${s.records} / ${s.planned}` : `${s.records}`);
  setText('remaining', clock(s.remaining_s));
  $('box-remaining').hidden = s.remaining_s == null;
  const lasts = s.disk?.lasts_s;
  setText('disk', !s.disk ? '–' : `${bytes(s.disk.free_bytes)}` + (lasts == null || s.status !== 'open' ? '' : lasts > 172800 ? ` (${Math.round(lasts / 86400)} days)` : ` (${clock(lasts)})`));
  $('box-disk').classList.toggle('bad', s.alerts.some(alert => alert.source === 'disk'));
  setText('label', s.label || '–');
  $('label').title = s.label;
  document.title = `${s.status === 'open' ? '● ' : ''}${run?.file ?? ''} ${s.records} – echofuse`;
  $('losses').replaceChildren(...sensors.map(name => {
    const row = document.createElement('tr'), x = s.sensors[name];
    const cells = [names[name], `${count(x.used)} ${unitOf(name, x.used)}`, count(x.missing), count(x.lost), count(x.late),
                   x.residual_s == null ? '–' : shortTime(x.residual_s)];
    cells.forEach((text, i) => {
      const cell = document.createElement(i ? 'td' : 'th');
      cell.textContent = text;
      if (i > 1 && i < 5 && text !== '0') cell.className = 'bad';
      row.append(cell);
    });
    return row;
  }));
  const nothing = document.createElement('li');
  nothing.textContent = 'none yet';
  const items = s.events.slice(-40).reverse().map(e => {
    const item = document.createElement('li'), when = document.createElement('time');
    item.className = e.level;
    when.textContent = timeOf(e.utc);
    item.append(when, ` ${['info', 'mark', 'note'].includes(e.level) ? '' : '⚠ '}${names[e.source] ?? e.source}: ${e.text}`);
    return item;
  });
  $('events').replaceChildren(...(items.length ? items : [nothing]));
}

function drawRecord() {
  if (!record || !run) return;
  const a = record.arrays, grid = run.map.half_tangent, made = record.reconstruction;
  // If the newest record has no data, the previous data stay visible, dimmed.
  const here = (at, has) => {
    if (has) newestWith[at] = record.index;
    return has ? '' : live && newestWith[at] != null ? `no data; last data in record ${newestWith[at]}` : 'no data in this record';
  };
  const shown = {spd: here('spd', a.spd), radar: here('radar', a.radar)};
  if (summed() === 1) drawMeasured(record, shown);
  $('card-zones').hidden = !a.zones;
  if (a.zones) zones.show(a.zones, record.zones);
  const square = (values, half, kind = 'near', of = span) => values &&
    [picture(values, ...values.shape, of, tables[kind], 1, kind === 'sure'), [-half, half, -half, half], of, values];
  const put = (at, all) => all ? (here(at, true), views[at].set(...all)) : views[at].lack(here(at, false), live);
  const percent = share => share == null ? '' : `${(100 * share).toFixed(share < 0.1 ? 1 : 0)} % without a return`;
  views.map.note = percent(record.holes?.map), views.camera.note = percent(record.holes?.camera);
  put('map', square(a.map, grid));
  if (a.camera) {
    const {depth_x: x, depth_y: y} = run.axes, [rows, columns] = a.camera.shape;
    const edges = axis => [axis.start - axis.step / 2, axis.start + (axis.count - 0.5) * axis.step];
    const [top, low] = edges(y);
    put('camera', [picture(a.camera, rows, columns, span, tables.near, 1e-3), [...edges(x), low, top], span, a.camera, 1e-3]);
  } else {
    put('camera', null);
  }
  if (run.model) {
    put('reconstruction', square(a.reconstruction, made.half_tangent));
    put('deviation', square(a.deviation, made.half_tangent, 'sure', [0, 2]));
    const isEmpty = a.reconstruction && !a.reconstruction.some(v => v > 0);
    const fault = faultOf(made);
    setText('maps-note', fault ? `No reconstruction: ${fault}`
      : [isEmpty && 'no body in the reconstruction', made.note, state?.doubt].filter(Boolean).join('; '));
    $('maps-note').className = made.fault || made.note || state?.doubt ? 'look' : '';
    drawMapsLamp();
  }
  drawPlan();
  const points = cloudOf === 'reconstruction' && a.reconstruction ? a.reconstruction : a.map;
  if (points || !live) cloud.set(points, cloudOf === 'reconstruction' && made ? made.half_tangent : grid, span);
  // Lists the verdicts if the display is held at this record. In live mode, the status indicators show the verdicts.
  setText('shown', $('shown').title = [`record ${record.index}${live ? ' (newest)' : ''}`, `${timeOf(record.utc, 21)} UTC`, record.label, ...(live ? [] : ['held', ...doubtsOf(record)])].filter(Boolean).join(', '));
  $('scrubber').setAttribute('aria-valuetext', $('shown').title);
  sheet.point(record.index);
}

// Draws a plan view of the sensors, the antenna power and the body, with the detector at the origin.
function drawPlan() {
  const {beams, track} = record.arrays, made = record.reconstruction, hasBeams = beams?.some(v => v > -Infinity);
  $('card-plan').hidden = !hasBeams && !track?.length;
  $('card-maps').classList.toggle('with-plan', !$('card-plan').hidden);
  if ($('card-plan').hidden) return;
  plan.show({beams: hasBeams ? beams : null, axis: run.axes.array, baseline: run.baseline_m, track,
             halfTangent: made?.half_tangent ?? run.map.half_tangent, label: run.axes.radar ? 'radar' : ''});
  setText('plan-of', [hasBeams && 'Power received by the antennas (30 dB)', track && 'positions of the body in the last minute', !run.baseline_m && run.axes.radar && 'baseline unknown, so the radar is drawn at the detector'].filter(Boolean).join('; '));
  const interval = made?.lateral_interval_90_m;
  setText('place', !made || made.fault ? '' : made.x_m == null ? 'no body in the reconstruction'
    : `body at x ${made.x_m.toFixed(2)} m${interval == null ? '' : ` ± ${interval.toFixed(2)} m (90 %)`}, z ${made.z_m.toFixed(2)} m, azimuth ${(Math.atan2(made.x_m, made.z_m) * 180 / Math.PI).toFixed(1)}°`);
}

// Shows the peak fits computed by the viewer. The difference between two histograms has no fit.
function takeFits(fits) {
  histogram.fit = histogram.difference ? null : fits?.spd, profile.fit = fits?.radar;
}
// Returns the number of records in the displayed sum; 0: all records since the newest mark.
const summed = () => +$('sum').value;
// Draws the histogram, the profile and the rates of one record or of a sum of records.
function drawMeasured({arrays, rates, fits, spd_records: records}, lacks) {
  histogram.records = records;
  takeFits(fits);
  histogram.take(arrays.spd ?? null, lacks.spd, live);
  profile.take(arrays.radar ?? null, lacks.radar, live);
  const hertz = v => v == null ? '–' : `${siNumber(v)}/s`, most = run.max_clicks_per_pulse, crowded = most > 0 && rates?.clicks_per_pulse > most;
  setText('sync-rate', hertz(rates?.sync_hz)), setText('click-rate', hertz(rates?.click_hz)), setText('dark-rate', hertz(rates?.dark_hz));
  setText('sync-name', rates?.sync_hz < 0.5 * rates?.pulse_hz ? 'filtered sync' : 'laser sync');
  setText('pulse-rate', rates?.clicks_per_pulse == null ? '–' : `${+rates.clicks_per_pulse.toPrecision(2)}`);
  $('box-pulse').classList.toggle('bad', crowded), $('pile-up').hidden = !crowded;
  if (crowded) setText('pile-up', `Pile-up. Reduce the light to at most ${most} clicks per pulse.`);
}
// Requests a new sum when the number of records or the range of the peak fit changes.
function askSum() {
  sum = null;
  const part = (histogram.marks.length === 2 || !profile.marks.length ? histogram : profile).part;
  link.ask({sum: [summed(), ...part]});
}

const take = {
  saved({utc, records, of}) {
    sheet.kept = records;
    setText('kept', `Saved at ${utc.slice(0, 16).replace('T', ' ')} UTC. This file contains ${records.length} of ${of} records in full, and the curves and thumbnails of the whole run.`);
    $('kept').hidden = false;
  },
  run(message) {
    const other = run?.uuid !== message.uuid;
    run = message;
    setText('file', run.file);
    setText('trigger', run.trigger), $('box-trigger').hidden = !run.trigger;
    setText('model', $('model').title = (run.model ?? '').replace('.safetensors', ''));
    setText('about', [`records of ${run.window_s} s`, run.host && `on ${run.host}`, run.operator && `by ${run.operator}`].filter(Boolean).join(' '));
    document.body.classList.toggle('with-model', !!run.model);
    for (const id of ['box-reconstruction', 'box-deviation', 'cloud-of']) $(id).hidden = !run.model;
    for (const id of ['mark', 'relabel']) $(id).disabled = !run.may_write;
    $('mark').title = run.may_write ? '' : 'needs a live run and the token in the address';
    if (other) {
      wasLive = false, spanKnown = false, sheetAt = -1, strip = null;
      for (const at in newestWith) delete newestWith[at];
      for (const at in views) views[at].image = null;
    }
    $('facts').replaceChildren(...run.facts.flatMap(words => ['dt', 'dd'].map((kind, i) => Object.assign(document.createElement(kind), {textContent: words[i]}))));
    const {spd, radar} = run.axes;
    const end = spd ? (spd.start + spd.count * spd.step) * metresPerPs : radar ? radar.start + radar.count * radar.step : 1;
    // The histogram and the profile have the same range axis, so that peaks at equal ranges are aligned.
    histogram.farthest = profile.farthest = end;
    if (run.axes.spd && (other || histogram.x?.length !== run.axes.spd.count)) histogram.axes(run.axes.spd);
    if (run.axes.radar) profile.axes(run.axes.radar);
    trouble('');
  },
  state(message) {
    const first = !state, ends = state?.status === 'open' && message.status !== 'open', camera = message.sensors.depth.configured;
    if (document.body.classList.toggle('no-camera', !camera)) cloudOf = 'reconstruction';
    state = message, received = performance.now(), wasLive ||= state.status === 'open';
    if (first && /^#\d+$/.test(location.hash)) show(+location.hash.slice(1));
    const scrubber = $('scrubber');
    if (state.last_index != null) {
      scrubber.min = state.first_index, scrubber.max = state.last_index;
      if (live) scrubber.value = state.last_index;
      else if (wanted != null) scrubber.value = wanted;
      if (sheetAt < 0 || ends || state.last_index > sheetAt + (spanKnown ? (sheetAt - state.first_index) / 8 + 3 : 0)) collect();
    }
    drawNumbers();
    drawLamps();
  },
  record(message) {
    if (message.live !== live) return;
    record = message;
    window.framesSeen++;
    trouble('');
    drawRecord();
  },
  sum(message) {
    sum = message;
    setText('rates-of', summed() === 1 || message.why ? message.why ?? '' : `of ${message.records} records from record ${message.from}`);
    if (summed() === 1) {  // for a sum of one record, the message `record` already contains these data
      takeFits(message.fits);
      for (const chart of [histogram, profile]) chart.readOut(null);
    } else drawMeasured(message, {spd: message.why ?? (message.arrays.spd ? '' : 'no data'), radar: message.why ?? (message.arrays.radar ? '' : 'no data')});
  },
  reference(message) {
    histogram.reference = message.arrays.spd;
    $('difference').disabled = !message.arrays.spd.length;
    histogram.show();
  },
  strip(message) {
    strip = message;
    if (run) strips.take({...strip.arrays, first: strip.arrays.time_s}, run.window_s);
    for (const [name, curve] of Object.entries(curves)) {
      const values = Array.from(strip.arrays[name], v => Number.isNaN(v) ? null : v);
      curve.at.parentElement.hidden = values.every(v => v == null);
      if (!curve.at.parentElement.hidden) curve.set([strip.arrays.time_s, values]);
    }
  },
  sheet(message) {
    sheet.take(message);
    if (!spanKnown && message.arrays.maps.some(v => v > 0)) {
      span = spanOf(message.arrays.maps), spanKnown = true;
      drawRecord();
    }
    sheet.draw(span);
    drawWaterfalls();
    if (record) sheet.point(record.index);
  },
  answer(message) {
    toast(message.text, !message.ok);
  },
  trouble(message) {
    trouble(message.text);
  },
};

// Draws both waterfalls: the logarithm of the clicks, and the radar power relative to its median. The colour scale ends
// at the maximum of the run.
function drawWaterfalls() {
  const {message} = sheet;
  if (!message || !run) return;
  const {time_s: time, ...rows} = message.arrays, step = time.length > 1 ? time[1] - time[0] : run.window_s;
  for (const [sensor, chart] of Object.entries(waterfalls)) {
    const table = rows[sensor], [records, bins] = table?.shape ?? [0, 0], {[sensor]: a} = run.axes;
    chart.at.closest('.of').hidden = !a || !records || !bins;
    if (chart.at.closest('.of').hidden) continue;
    const turned = new Float32Array(bins * records).fill(NaN);
    for (let r = 0; r < records; ++r) {
      const row = table.subarray(r * bins, (r + 1) * bins), middle = Float32Array.from(row).sort()[bins >> 1];
      if (row[0] === row[0])
        row.forEach((v, b) => { turned[(bins - 1 - b) * records + r] = sensor === 'spd' ? Math.log1p(v) : Math.max(v - middle, 0); });
    }
    const most = turned.reduce((top, v) => v > top ? v : top, 1), unit = sensor === 'spd' ? metresPerPs : 1;
    // The range axis starts at 0. Ranges below the first bin of the sensor are blank.
    const nothing = Math.max(0, Math.round(bins * a.start / (a.count * a.step)));
    const whole = new Float32Array((bins + nothing) * records).fill(NaN);
    whole.set(turned);
    chart.show(picture(whole, bins + nothing, records, [0, most], tables.level, 1, true), [time[0], time.at(-1) + step], (a.start + a.count * a.step) * unit, tables.level,
               ['0', sensor === 'spd' ? siNumber(Math.expm1(most)) : `${most.toFixed(0)} dB`]);
  }
}

function trouble(text) {
  setText('trouble', text);
  $('trouble').hidden = !text;
}
function toast(text, bad) {
  setText('toast', text);
  $('toast').className = bad ? 'bad' : '';
  $('toast').hidden = false;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => { $('toast').hidden = true; }, 4000);
}
function collect() {
  if (state?.last_index == null) return;
  sheetAt = state.last_index;
  link.ask({sheet: [state.first_index, state.last_index]});
}
function show(index) {
  if (state?.last_index == null) return;
  const from = here();
  live = index === 'live';
  wanted = live ? null : Math.min(Math.max(index, state.first_index), state.last_index);
  if (file && !live) wanted = link.next(wanted, from);
  $('live').setAttribute('aria-pressed', live);
  document.body.classList.toggle('held', !live);
  $('scrubber').value = live ? state.last_index : wanted;
  link.ask({show: live ? 'live' : wanted});
}
const here = () => wanted ?? record?.index ?? 0;

function toggle(id, key) {
  histogram[key] = !histogram[key];
  $(id).setAttribute('aria-pressed', histogram[key]);
  histogram.renew();
  histogram.show();
}
const actions = {
  g: () => toggle('log', 'log'),
  d: () => $('difference').disabled || toggle('difference', 'difference'),
  h: () => {
    histogram.held = histogram.held ? null : histogram.counts && Array.from(histogram.counts);
    $('hold').setAttribute('aria-pressed', !!histogram.held);
    histogram.show();
  },
  c: () => {
    spanKnown = false;
    collect();
  },
  m: () => ask('mark', 'text of the mark'),
  l: () => ask('label', 'label for the following records'),
  s: () => alarm.toggle(),
  f: () => {
    $('far').setAttribute('aria-pressed', document.documentElement.classList.toggle('far'));
    redraw();
  },
  n: () => {
    const ns = histogram.unit === units.m;
    $('unit').setAttribute('aria-pressed', ns);
    for (const chart of [histogram, profile]) chart.measure(ns ? units.ns : units.m);
    askSum();
  },
  t: () => {
    root.dataset.theme = isDark() ? 'light' : 'dark';
    redraw();
  },
  '?': () => $('keys').showModal(),
  ' ': () => show(live ? here() : 'live'),
  ArrowLeft: () => show(here() - 1),
  ArrowRight: () => show(here() + 1),
  Home: () => show(state?.first_index ?? 0),
  End: () => show('live'),
};
function redraw() {
  histogram.renew();
  profile.renew();
  strips.renew();
  for (const chart of Object.values(curves)) if (chart.data) chart.renew();
  for (const chart of Object.values(waterfalls)) if (chart.data) chart.renew();
  drawWaterfalls();
  drawRecord();
  sheet.draw(span);
}
function ask(what, words) {
  if (!run?.may_write) return toast('marking needs a live run and the token in the address', true);
  setText('ask-what', words);
  $('ask').dataset.what = what;
  $('ask-text').value = what === 'label' ? state.label : '';
  $('ask').returnValue = '';
  $('ask').showModal();
  $('ask-text').select();
}
$('ask').addEventListener('close', () => {
  const text = $('ask-text').value.trim();
  if ($('ask').returnValue === 'ok' && (text || $('ask').dataset.what === 'label')) link.ask({[$('ask').dataset.what]: text});
});
$('ask-text').addEventListener('keydown', e => {
  if (e.key === 'Enter') e.preventDefault(), $('ask').close('ok');
});

for (const [id, key] of [['log', 'g'], ['hold', 'h'], ['difference', 'd'], ['mark', 'm'], ['relabel', 'l'], ['sound', 's'], ['unit', 'n'], ['far', 'f'],
                         ['theme', 't'], ['help', '?'], ['sheet-again', 'c'], ['live', ' ']])
  $(id).addEventListener('click', () => actions[key]());
for (const of of ['map', 'reconstruction'])
  $(`cloud-${of}`).addEventListener('click', () => {
    cloudOf = of;
    for (const other of ['map', 'reconstruction']) $(`cloud-${other}`).setAttribute('aria-pressed', other === of);
    drawRecord();
  });
for (const [id, chart] of [['histogram', histogram], ['profile', profile]])
  for (const kind of ['png', 'csv'])
    $(`${id}-${kind}`).addEventListener('click', () => chart.save(kind, `${run?.file.replace(/\.sqlite$/, '') ?? 'echofuse'}-${record?.index ?? 0}-${id}`));
for (const chart of [histogram, profile]) chart.changed = askSum;
$('sum').addEventListener('change', askSum);
$('scrubber').addEventListener('input', e => show(+e.target.value));
document.addEventListener('keydown', e => {
  if (e.ctrlKey || e.altKey || e.metaKey || document.querySelector('dialog[open]')) return;
  if (e.key === ' ' && ['BUTTON', 'SUMMARY'].includes(e.target.tagName) || e.target.tagName === 'SELECT') return;
  const action = actions[e.key];
  if (!action) return;
  e.preventDefault();
  action();
});
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
// Uses the light theme and a fixed width for printed pages.
const root = document.documentElement;
let theme;
addEventListener('beforeprint', () => {
  theme = root.dataset.theme, root.dataset.theme = 'light', root.classList.add('paper');
  redraw();
});
addEventListener('afterprint', () => {
  root.classList.remove('paper');
  if (theme) root.dataset.theme = theme;
  else delete root.dataset.theme;
  redraw();
});
document.body.classList.toggle('saved', file);
$('acknowledge').addEventListener('click', () => (storage[known()] = state.doubtful, drawDoubts()));
addEventListener('hashchange', () => /^#\d+$/.test(location.hash) && (show(+location.hash.slice(1)), $('bar').scrollIntoView()));
setInterval(() => {
  drawLamps();
  if (!state) return;
  alarm.take([...reached() ? [] : ['viewer'], ...state.alerts.filter(alert => alert.source !== 'run' || wasLive).map(alert => `${alert.source} ${alert.kind}`)]);
  const running = state.status === 'open' && !file && reached() ? (performance.now() - received) / 1000 : 0;
  setText('elapsed', clock(state.elapsed_s + running));
}, 200);

const chosen = location.pathname.match(/\/(?:run\/[^/]+|newest)\/[^/]*$/);
$('runs').hidden = !chosen;
$('runs').href = `${chosen?.[0].startsWith('/run/') ? '../../' : '../'}${location.search}`;
const link = new (file ? Saved : Link)(message => {
  lastMessage = performance.now();
  take[message.kind]?.(message);
}, (open, why) => {
  connected = open;
  if (why) trouble(why);
  if (open && (file || !live)) show(live ? 'live' : here());
  if (open && (sum || summed() !== 1)) askSum();
  if (state) drawNumbers(), drawLamps();
  else setText('status', open ? 'connected' : 'no connection to the viewer');
});
