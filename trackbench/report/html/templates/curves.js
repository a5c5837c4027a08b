// Interactive figures: hide a filter, read a value, zoom, linear or logarithmic. `data-live` has the axes and
// the values of the curves, `data-of` the curve of a shape. Zooming moves the shapes that matplotlib drew.
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const forward = (axis, value) => (axis.log ? Math.log10(Math.max(value, 1e-300)) : value);
  const backward = (axis, value) => (axis.log ? 10 ** value : value);
  const node = (name, attributes, parent) => {
    const element = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (parent) parent.append(element);
    return element;
  };

  // An axis as it was drawn, or as it is shown: between a value and its place in the drawing.
  const place = (axis, from, to, value) => {
    const [low, high] = axis.ends.map((end) => forward(axis, end));
    return from + ((forward(axis, value) - low) / (high - low)) * (to - from);
  };
  const valueAt = (axis, from, to, at) => {
    const [low, high] = axis.ends.map((end) => forward(axis, end));
    return backward(axis, low + ((at - from) / (to - from)) * (high - low));
  };

  // A path as commands with absolute points; `compact` writes lines relative to the last point.
  const parse = (d) => {
    const commands = [];
    let at = [0, 0];
    for (const [, letter, rest] of d.matchAll(/([MLlQCz])([^MLlQCz]*)/g)) {
      const numbers = (rest.match(/-?(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?/g) || []).map(Number);
      const points = [];
      for (let i = 0; i + 1 < numbers.length; i += 2) {
        at = letter === "l" ? [at[0] + numbers[i], at[1] + numbers[i + 1]] : [numbers[i], numbers[i + 1]];
        points.push(at);
      }
      commands.push([letter === "l" ? "L" : letter, points]);
    }
    return commands;
  };

  class Panel {
    constructor(figure, drawn, index) {
      Object.assign(this, { figure, drawn, box: drawn.box });
      this.root = figure.svg.querySelector(`[data-axes="${index}"]`);
      this.shapes = [];
      for (const element of this.root.querySelectorAll("[clip-path]")) {
        if (element.closest('[id*="tick_"]')) continue;
        for (const shape of element.localName === "g" ? element.querySelectorAll("path, use") : [element]) this.add(shape);
      }
      const clip = this.shapes[0]?.element.getAttribute("clip-path") ?? this.shapes[0]?.element.parentNode.getAttribute("clip-path");
      for (const image of this.root.querySelectorAll("image")) this.addImage(image, clip);
      let abscissas;  // of the curve before, if one has none; an SVG of an older version has no curves
      this.curves = (drawn.curves ?? []).map(({ of, color, x, y, stderr = [] }) => {
        abscissas = x ?? abscissas;
        const points = abscissas.map((value, i) => [value, y[i]]);
        return { number: of, color, points, stderr };
      });
      this.single = this.curves.every(({ points }) => points.every((p, i) => !i || p[0] >= points[i - 1][0]));
    }
    add(element) {
      const number = (name) => parseFloat(element.getAttribute(name));
      if (element.localName === "path") {
        if (!element.closest("defs")) this.shapes.push({ element, d: element.getAttribute("d"), path: parse(element.getAttribute("d") || "") });
      } else if (element.localName === "use") {
        this.shapes.push({ element, at: [number("x"), number("y")] });
      }
    }
    // matplotlib draws pixels upside down, y upwards: from -y to height - y, and not clipped.
    addImage(element, clip) {
      const [x, y, width, height] = ["x", "y", "width", "height"].map((name) => parseFloat(element.getAttribute(name)));
      const frame = node("g", clip ? { "clip-path": clip } : {});
      element.replaceWith(frame);
      frame.append(element);
      element.setAttribute("preserveAspectRatio", "none");
      this.shapes.push({ element, image: [[x, -y], [x + width, height - y]] });
    }
    axes() {
      const { views } = this.figure;
      return [views[this.drawn.x.group], views[this.drawn.y.group]];
    }
    // The place of a value in the present view, and that of a point of the original drawing.
    now([x, y]) {
      const [left, top, right, bottom] = this.box, [across, up] = this.axes();
      return [place(across, left, right, x), Math.min(place(up, bottom, top, y), bottom + 1e4)];
    }
    moved([x, y]) {
      const [left, top, right, bottom] = this.box;
      return this.now([valueAt(this.drawn.x, left, right, x), valueAt(this.drawn.y, bottom, top, y)]);
    }
    draw() {
      const [across, up] = this.axes(), as = (view, drawn) => view.log === drawn.log && view.ends.every((end, i) => end === drawn.ends[i]);
      const original = as(across, this.drawn.x) && as(up, this.drawn.y);
      const text = (point) => point.map((x) => x.toFixed(2)).join(" ");
      for (const shape of this.shapes) {
        const { element } = shape;
        if (shape.path) {
          if (!shape.d) continue;
          element.setAttribute("d", original ? shape.d : shape.path.map(([letter, points]) => letter + points.map((p) => text(this.moved(p))).join(" ")).join(""));
        } else if (shape.at) {
          const [x, y] = original ? shape.at : this.moved(shape.at);
          element.setAttribute("x", x);
          element.setAttribute("y", y);
        } else if (shape.image) {
          const [[x, y], [right, bottom]] = original ? shape.image : shape.image.map((corner) => this.moved(corner));
          for (const [name, value] of Object.entries({ x, y: -y, width: right - x, height: bottom - y })) element.setAttribute(name, value);
          element.setAttribute("transform", `scale(1 -1) translate(0 ${y - bottom})`);
        }
      }
      this.ticks(original);
    }
    ticks(original) {
      this.scales?.remove();
      this.root.querySelectorAll('[id*="-xtick_"], [id*="-ytick_"]').forEach((tick) => { tick.style.display = original ? "" : "none"; });
      if (original) return;
      this.scales = node("g", { "font-size": 9 });
      this.root.insertBefore(this.scales, this.root.children[1]);
      const [left, top, right, bottom] = this.box;
      this.axes().forEach((axis, vertical) => {
        const label = this.root.querySelector(`[id*="-${"xy"[vertical]}tick_"] text`);
        for (const value of ticks(axis)) {
          const at = vertical ? place(axis, bottom, top, value) : place(axis, left, right, value);
          const ends = vertical ? { x1: left, x2: right, y1: at, y2: at } : { x1: at, x2: at, y1: top, y2: bottom };
          node("line", { ...ends, stroke: "#dddddd", "stroke-width": 0.5 }, this.scales);
          if (!label) continue;
          const where = vertical ? { x: left - 5, y: at + 3.2, "text-anchor": "end" } : { x: at, y: bottom + 13, "text-anchor": "middle" };
          node("text", where, this.scales).textContent = String(+value.toPrecision(6));
        }
      });
    }
    inside([x, y]) {
      const [left, top, right, bottom] = this.box;
      return x >= left && x <= right && y >= top && y <= bottom;
    }
    // The values of all curves at the abscissa nearest to a point of the drawing; of tracks, the nearest value.
    read([x, y]) {
      const shown = this.curves.filter(({ number }) => !this.figure.hidden.has(number));
      const placed = shown.map((curve) => [curve, curve.points.map((point) => this.now(point))]);
      const [, snapped] = nearest(placed.flatMap(([, points]) => points), (at) => (this.single ? Math.abs(at[0] - x) : Math.hypot(at[0] - x, at[1] - y)));
      const rows = [];
      for (const [curve, points] of placed) {
        const i = points.findIndex((at) => (this.single ? Math.abs(at[0] - snapped[0]) < 0.05 : at === snapped));
        if (i >= 0) rows.push({ curve, at: points[i], value: curve.points[i], error: curve.stderr[i] });
      }
      return rows.sort((a, b) => b.value[1] - a.value[1]);
    }
  }

  const nearest = (points, distance) => {
    let best, least = Infinity;
    for (const point of points) if (distance(point) < least) [best, least] = [point, distance(point)];
    return [least, best];
  };

  const digits = (value) => String(+value.toPrecision(3));
  const exponent = (number) => Math.floor(Math.log10(Math.abs(number)));
  // As in the tables: to the same place, which is the error's first or second digit.
  const withError = (value, error) => {
    if (!(error > 0)) return digits(value);
    const first = -exponent(error), places = value ? Math.min(Math.max(3 - exponent(value), first), first + 1) : first + 1;
    if (places > 7 || Math.abs(value) >= 1e6) return `${value.toExponential(2)} ± ${error.toExponential(1)}`;
    return [value, error].map((x) => x.toFixed(Math.max(places, 0))).join(" ± ");
  };

  const ticks = ({ log, ends: [low, high] }) => {
    if (log && high / low > 6) {
      const places = [], parts = high / low > 300 ? [1] : [1, 2, 5];
      for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k++) places.push(...parts.map((m) => m * 10 ** k));
      return places.filter((x) => x >= low && x <= high);
    }
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= rough);
    const places = [];
    for (let i = Math.ceil(low / step); i * step <= high; i++) places.push(i * step);
    return places;
  };

  class Figure {
    constructor(element, svg) {
      Object.assign(this, { element, svg, hidden: new Set() });
      this.drawn = JSON.parse(svg.dataset.live);
      this.reset();
      this.keys();
      this.bar = element.querySelector("figcaption");
      this.note = document.createElement("div");
      this.note.className = "readout";
      this.note.setAttribute("aria-live", "polite");
      this.note.hidden = true;
      element.append(this.note);
      svg.setAttribute("tabindex", "0");
      for (const name of ["pointerdown", "pointermove", "pointerup", "pointerleave", "pointercancel"]) svg.addEventListener(name, (event) => this[name]?.(event));
      svg.addEventListener("dblclick", () => this.show(() => this.reset()));
      svg.addEventListener("keydown", (event) => this.keydown(event));
      this.undo = this.button("Whole figure", () => this.show(() => this.reset()));
      this.undo.hidden = true;
      const drawn = this.drawn.axes;
      if (drawn.some(({ equal }) => equal) || svg.querySelector("image")) return;
      const log = drawn.every(({ y }) => y.log);
      if (!drawn.every(({ y }) => y.log || (y.ends[1] > 0 && y.ends[0] > -0.1 * y.ends[1]))) return;  // both signs
      this.scale = this.button(log ? "Linear axis" : "Log axis", () => this.show(() => this.turn()));
    }
    button(text, act) {
      const element = document.createElement("button");
      Object.assign(element, { type: "button", textContent: text, className: "tool" });
      element.addEventListener("click", act);
      this.bar.append(element);
      return element;
    }
    get panels() {
      this.created ??= this.drawn.axes.map((drawn, i) => new Panel(this, drawn, i));
      return this.created;
    }
    reset() {
      this.views = {};
      for (const axes of this.drawn.axes) for (const name of ["x", "y"]) this.views[axes[name].group] ??= { log: axes[name].log, ends: [...axes[name].ends] };
      this.turned = false;
    }
    show(change) {
      change();
      for (const panel of this.panels) panel.draw();
      this.undo.hidden = !this.turned && this.drawn.axes.every((axes) => ["x", "y"].every((n) => axes[n].ends.every((end, i) => end === this.views[axes[n].group].ends[i])));
      if (this.scale) this.scale.textContent = this.drawn.axes.every(({ y }) => this.views[y.group].log) ? "Linear axis" : "Log axis";
      this.note.hidden = true;
      this.cursor?.remove();
    }
    turn() {
      this.turned = !this.turned;
      for (const { y } of this.drawn.axes) {
        const view = this.views[y.group];
        view.log = this.turned ? !y.log : y.log;
        view.ends = [...y.ends];
        if (!view.log) view.ends[0] = Math.min(0, view.ends[0]);
        if (!view.log || y.log) continue;
        const rounding = 1e-12 * view.ends[1];
        const curves = this.panels.filter((panel) => panel.drawn.y.group === y.group).flatMap((panel) => panel.curves);
        const values = curves.flatMap(({ points }) => points.map(([, value]) => value)).filter((value) => value > rounding);
        const least = values.reduce((a, b) => Math.min(a, b), Infinity);
        view.ends[0] = least < view.ends[1] ? 0.9 * least : 1e-3 * view.ends[1];
      }
    }
    keys() {
      for (const key of this.svg.querySelectorAll("[data-key]")) {
        const number = +key.dataset.key, words = key.querySelector("text") !== null;
        const act = () => this.toggle(number);
        key.classList.add("key");
        key.addEventListener("click", act);
        if (!words) continue;
        for (const [name, value] of [["tabindex", 0], ["role", "button"], ["aria-pressed", true], ["aria-label", `Show ${this.drawn.labels[number]}`]]) key.setAttribute(name, value);
        key.addEventListener("keydown", (event) => {
          if (event.key !== "Enter" && event.key !== " ") return;
          event.preventDefault();
          event.stopPropagation();
          act();
        });
      }
    }
    toggle(number) {
      const hide = !this.hidden.has(number);
      this.hidden[hide ? "add" : "delete"](number);
      this.svg.querySelectorAll(`[data-of="${number}"]`).forEach((shape) => { shape.style.display = hide ? "none" : ""; });
      this.svg.querySelectorAll(`[data-key="${number}"]`).forEach((key) => {
        key.classList.toggle("off", hide);
        if (key.hasAttribute("aria-pressed")) key.setAttribute("aria-pressed", String(!hide));
      });
      this.note.hidden = true;
      this.cursor?.remove();
    }
    where(event) {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
      return [at.x, at.y];
    }
    pointerdown(event) {
      const at = this.where(event), panel = this.panels.find((p) => p.inside(at));
      if (!panel || event.button || event.target.closest("[data-key]")) return;
      if (event.pointerType === "touch") return this.read(panel, at);
      event.preventDefault();
      this.svg.setPointerCapture(event.pointerId);
      this.drag = { panel, from: at };
    }
    pointermove(event) {
      const at = this.where(event);
      if (!this.drag) {
        const panel = event.pointerType !== "touch" && this.panels.find((p) => p.inside(at));
        return panel ? this.read(panel, at) : this.pointerleave();
      }
      const { panel, from } = this.drag, [left, top, right, bottom] = panel.box;
      const x = [from[0], at[0]].map((v) => Math.min(Math.max(v, left), right)).sort((a, b) => a - b);
      const y = [from[1], at[1]].map((v) => Math.min(Math.max(v, top), bottom)).sort((a, b) => a - b);
      // A drag along one axis zooms that one.
      if (x[1] - x[0] < 8) [x[0], x[1]] = [left, right];
      else if (y[1] - y[0] < 8) [y[0], y[1]] = [top, bottom];
      this.frame?.remove();
      this.frame = node("rect", { x: x[0], y: y[0], width: x[1] - x[0], height: y[1] - y[0], class: "frame" }, this.svg);
      this.drag.to = [x, y];
    }
    pointerup(event) {
      const { panel, from, to } = this.drag ?? {}, at = this.where(event);
      this.pointercancel();
      if (!to || Math.hypot(at[0] - from[0], at[1] - from[1]) < 8) return;
      const [left, top, right, bottom] = panel.box, [across, up] = panel.axes(), [x, y] = to;
      this.show(() => {
        const sides = x.map((v) => valueAt(across, left, right, v)), ends = [y[1], y[0]].map((v) => valueAt(up, bottom, top, v));
        if (panel.drawn.equal) {  // as much of both, so that the scales stay equal
          const share = Math.max((x[1] - x[0]) / (right - left), (y[1] - y[0]) / (bottom - top));
          for (const [axis, [a, b]] of [[across, sides], [up, ends]]) {
            const half = 0.5 * share * (axis.ends[1] - axis.ends[0]), middle = 0.5 * (a + b);
            axis.ends = [middle - half, middle + half];
          }
          return;
        }
        across.ends = sides;
        up.ends = ends;
      });
    }
    pointercancel() {
      this.drag = undefined;
      this.frame?.remove();
    }
    pointerleave() {
      if (this.drag) return;
      this.note.hidden = true;
      this.cursor?.remove();
    }
    keydown(event) {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], panel = this.last?.panel ?? this.panels[0];
      if (!step || event.target !== this.svg) return;
      event.preventDefault();
      const shown = panel.curves.find(({ number }) => !this.hidden.has(number));
      if (!shown) return;
      const places = shown.points.map((p) => panel.now(p)).filter((p) => panel.inside([p[0], panel.box[1]]));
      const now = this.last ? places.findIndex((p) => p[0] >= this.last.x - 0.01) : step > 0 ? -1 : places.length;
      const next = places[Math.min(Math.max(now + step, 0), places.length - 1)];
      if (next) this.read(panel, next);
    }
    read(panel, at) {
      const rows = panel.read(at);
      this.cursor?.remove();
      this.note.hidden = !rows.length;
      if (!rows.length) return;
      const [left, top, right, bottom] = panel.box, x = rows[0].at[0];
      this.last = { panel, x };
      const { zero } = panel.drawn.x, first = rows[0].value[0];
      this.cursor = node("g", { "pointer-events": "none" }, this.svg);
      if (panel.single) node("line", { x1: x, x2: x, y1: top, y2: bottom, class: "cursor" }, this.cursor);
      for (const row of rows) if (panel.inside(row.at)) node("circle", { cx: row.at[0], cy: row.at[1], r: 2.2, fill: row.curve.color }, this.cursor);
      const lines = rows.map(({ curve, value, error }) => {
        const line = document.createElement("div"), dot = document.createElement("i"), number = document.createElement("b");
        dot.style.backgroundColor = curve.color;
        number.textContent = panel.single ? withError(value[1], error) : value.map(digits).join(", ");
        line.append(dot, `${this.drawn.labels[curve.number]} `, number);
        return line;
      });
      const head = document.createElement("div");
      head.textContent = panel.single ? `at ${first === zero ? 0 : digits(first)}` : "nearest point";
      this.note.replaceChildren(head, ...lines);
      const home = this.element.getBoundingClientRect(), corner = new DOMPoint(x, Math.max(at[1], top)).matrixTransform(this.svg.getScreenCTM());
      const room = home.width - this.note.offsetWidth - 4, beside = corner.x - home.left + 14;
      this.note.style.left = `${Math.max(4, beside > room ? beside - 28 - this.note.offsetWidth : beside)}px`;
      this.note.style.top = `${Math.max(4, corner.y - home.top - this.note.offsetHeight / 2) + this.element.scrollTop}px`;
    }
  }

  document.querySelectorAll("figure svg[data-live]").forEach((svg) => new Figure(svg.closest("figure"), svg));
})();
