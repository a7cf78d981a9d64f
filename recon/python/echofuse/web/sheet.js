// SPDX-License-Identifier: MIT
// Shows thumbnails of depth maps at regular intervals over the run. A click on a thumbnail selects its record.

class Sheet {
  constructor(choose) {
    this.box = document.getElementById('sheet');
    this.choose = choose;
  }
  take(message) {
    this.message = message;
  }
  draw(span) {
    if (!this.message) return;
    const {index, label, lacks, arrays: {maps}} = this.message, side = maps.shape[1], shown = 3 * side;
    const step = index.length > 1 ? (index.at(-1) - index[0]) / (index.length - 1) : 1;
    document.getElementById('sheet-of').textContent = index.length ? `camera images of ${index.length} records`
      + (step > 1.01 ? `, one of every ${+step.toFixed(1)} records` : '') : '';
    this.box.replaceChildren(...index.map((at, i) => {
      const button = document.createElement('button'), canvas = document.createElement('canvas');
      const words = document.createElement('span');
      button.type = 'button', button.dataset.index = at, button.disabled = this.kept && !this.kept.includes(at);
      canvas.width = canvas.height = shown;
      fill(canvas, picture(maps.subarray(i * side * side, (i + 1) * side * side), side, side, span, tables.near));
      if (lacks[i]) {
        const c = canvas.getContext('2d');
        c.strokeStyle = colour('--bad'), c.lineWidth = 3;
        c.beginPath(), c.moveTo(0, 0), c.lineTo(shown, shown), c.moveTo(shown, 0), c.lineTo(0, shown), c.stroke();
      }
      words.textContent = [at, lacks[i] ? 'no data' : label[i] !== label[i - 1] && label[i]].filter(v => v || v === 0).join(' ');
      button.append(canvas, words);
      button.addEventListener('click', () => this.choose(at));
      return button;
    }));
  }
  point(index) {
    for (const button of this.box.children) button.classList.toggle('shown', +button.dataset.index === index);
  }
}
