// SPDX-License-Identifier: MIT
// The contact sheet: small maps of records spread over the run; a click shows the record.
import {picture, tables} from './maps.js';

export class Sheet {
  constructor(choose) {
    this.box = document.getElementById('sheet');
    this.choose = choose;
  }
  take(message) {
    this.message = message;
  }
  draw(span) {
    if (!this.message) return;
    const {index, label, arrays: {maps}} = this.message, side = maps.shape[1];
    this.box.replaceChildren(...index.map((at, i) => {
      const button = document.createElement('button'), canvas = document.createElement('canvas');
      const words = document.createElement('span');
      button.type = 'button', button.dataset.index = at;
      canvas.width = canvas.height = side;
      canvas.getContext('2d').drawImage(picture(maps.subarray(i * side * side, (i + 1) * side * side), side, side, span, tables.near), 0, 0);
      words.textContent = label[i] ? `${at} ${label[i]}` : `${at}`;
      button.append(canvas, words);
      button.addEventListener('click', () => this.choose(at));
      return button;
    }));
  }
  point(index) {
    for (const button of this.box.children) button.classList.toggle('shown', +button.dataset.index === index);
  }
}
