// Draws the walks of a page: for each, the robot from the side and from above, frame by frame, all at the same time.
(() => {
  const data = JSON.parse(document.getElementById("walks").textContent);
  const walks = [...document.querySelectorAll(".walk")].map((place, k) => ({
    side: place.querySelector(".side"), top: place.querySelector(".top"), told: place.querySelector(".told"),
    film: data.films[k],
  }));
  const slider = document.getElementById("moment"), button = document.getElementById("play");
  const clock = document.getElementById("clock"), speed = document.getElementById("speed");
  const C = { ink: "#20262e", soft: "#5d6876", line: "#dfe4ea", steel: "#9aa4b2", far: "#c5ccd5", trunk: "#d3d9e1",
    box: "#d9822b", boxEdge: "#9c5a14", truth: "#b3261e", belief: "#0b6bcb", good: "rgba(26,127,67,.16)",
    goodEdge: "#1a7f43", bad: "rgba(179,38,30,.22)" };
  const frames = Math.max(...walks.map((w) => w.film.time.length));
  slider.max = frames - 1;
  let at = Math.min(data.start, frames - 1), playing = false, last = 0, carry = 0;

  const hull = (points) => {
    const p = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (list) => {
      const h = [];
      for (const q of list) {
        while (h.length > 1) {
          const [a, b] = [h[h.length - 2], h[h.length - 1]];
          if ((b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0]) > 0) break;
          h.pop();
        }
        h.push(q);
      }
      h.pop();
      return h;
    };
    return [...half(p), ...half(p.reverse())];
  };

  const prepare = (canvas) => {
    const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
      canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio);
    }
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, w, h);
    g.lineJoin = g.lineCap = "round";
    g.font = "12px system-ui, sans-serif";
    return [g, w, h];
  };
  const path = (g, points, closed) => {
    g.beginPath();
    points.forEach(([x, y], k) => (k ? g.lineTo(x, y) : g.moveTo(x, y)));
    if (closed) g.closePath();
  };
  const shape = (g, points, fill, edge, width = 1.5) => {
    path(g, hull(points), true);
    g.fillStyle = fill; g.fill();
    if (edge) { g.strokeStyle = edge; g.lineWidth = width; g.stroke(); }
  };
  const dot = (g, [x, y], r, fill, edge, width = 2) => {
    g.beginPath(); g.arc(x, y, r, 0, 2 * Math.PI);
    if (fill) { g.fillStyle = fill; g.fill(); }
    if (edge) { g.strokeStyle = edge; g.lineWidth = width; g.stroke(); }
  };
  const isThere = (corners) => corners[0][0] !== null;

  const side = (canvas, film, k) => {
    const [g, w, h] = prepare(canvas), scale = Math.min(w / 1.5, h / 1.25), ground = h - 34;
    const middle = film.com[k][0], foot = data.foot;
    const to = (p) => [w / 2 + (p[0] - middle) * scale, ground - p[2] * scale];
    g.strokeStyle = C.ink; g.lineWidth = 1.5;
    path(g, [[0, ground], [w, ground]]); g.stroke();
    g.fillStyle = C.soft; g.textAlign = "center"; g.lineWidth = 1;
    const step = 0.2, first = Math.ceil((middle - w / 2 / scale) / step);
    for (let n = first; n * step < middle + w / 2 / scale; n++) {
      const x = to([n * step, 0, 0])[0];
      path(g, [[x, ground], [x, ground + 5]]); g.stroke();
      if (x > 24 && x < w - 24) g.fillText(`${(n * step).toFixed(1)} m`, x, ground + 19);
    }
    const leg = (n, colour, width) => {
      const points = film.legs[k][n].map(to);
      g.strokeStyle = colour; g.lineWidth = width; path(g, points); g.stroke();
      dot(g, points[3], Math.max(foot * scale, 3), colour);
    };
    leg(1, C.far, 6); leg(3, C.far, 6);
    shape(g, film.trunk[k].map(to), C.trunk, C.steel);
    leg(0, C.steel, 7); leg(2, C.steel, 7);
    if (isThere(film.box[k])) shape(g, film.box[k].map(to), C.box, C.boxEdge);
    const [x, y] = to(film.com[k]);
    g.setLineDash([4, 4]); g.strokeStyle = C.truth; g.lineWidth = 1.5;
    path(g, [[x, y], [x, ground]]); g.stroke(); g.setLineDash([]);
    film.legs[k].forEach((points, n) => {
      const f = film.force[k][n], [fx] = to(points[3]);
      if (f > 5) {
        const length = f * 0.00045 * scale;
        g.strokeStyle = C.goodEdge; g.fillStyle = C.goodEdge; g.lineWidth = 2;
        path(g, [[fx, ground], [fx, ground - length]]); g.stroke();
        path(g, [[fx - 4, ground - length], [fx + 4, ground - length], [fx, ground - length - 7]], true); g.fill();
      }
    });
    dot(g, to(film.model[k]), 7, null, C.trunk);
    dot(g, [x, y], 4.5, C.truth);
  };

  const above = (canvas, film, k) => {
    const [g, w, h] = prepare(canvas), scale = Math.min(w / 1.5, h / 0.78), [mx, my] = film.com[k];
    const to = (p) => [w / 2 + (p[0] - mx) * scale, h / 2 - (p[1] - my) * scale];
    const out = film.margin[k] !== null && film.margin[k] < 0;
    shape(g, film.trunk[k].map(to), "rgba(211,217,225,.45)", C.line);
    if (isThere(film.box[k])) shape(g, film.box[k].map(to), "rgba(217,130,43,.55)", C.boxEdge);
    const feet = film.legs[k].map((points) => to(points[3]));
    const down = feet.filter((_, n) => film.down[k][n]);
    if (down.length > 2) shape(g, down, out ? C.bad : C.good, out ? C.truth : C.goodEdge, out ? 2.5 : 1.5);
    g.textAlign = "center";
    feet.forEach((p, n) => {
      const f = film.force[k][n], left = film.legs[k][n][3][1] > my;
      if (film.down[k][n]) dot(g, p, 2 + 0.8 * Math.sqrt(f), C.steel);
      else dot(g, p, 5, "#fff", C.steel);
      g.fillStyle = C.ink;
      const y = p[1] + (left ? -16 - 0.3 * Math.sqrt(f) : 26 + 0.3 * Math.sqrt(f));
      g.fillText(film.down[k][n] ? `${data.feet[n]} ${f.toFixed(0)} N` : `${data.feet[n]} swings`, p[0], y);
    });
    dot(g, to(film.model[k]), 8, null, C.trunk, 2.5);
    dot(g, to(film.com[k]), 5, C.truth);
  };

  const draw = () => {
    for (const { side: s, top: t, told, film } of walks) {
      const k = Math.min(at, film.time.length - 1), over = at >= film.time.length && film.fell;
      side(s, film, k); above(t, film, k);
      const margin = film.margin[k], cm = margin === null ? "–" : `${(100 * margin).toFixed(1)} cm`;
      told.textContent = over ? "fallen" : `${film.states[film.state[k]]} · margin ${cm}`;
      told.classList.toggle("out", over || (margin !== null && margin < 0));
    }
    clock.textContent = `${(data.every * at).toFixed(2)} s`;
    slider.value = at;
  };
  const tick = (now) => {
    if (!playing) return;
    carry += ((now - last) / 1000 / data.every) * Number(speed.value); last = now;
    const whole = Math.floor(carry); carry -= whole;
    at = (at + whole) % frames;
    if (whole) draw();
    requestAnimationFrame(tick);
  };
  const play = (on) => {
    playing = on; button.textContent = on ? "Pause" : "Play"; last = performance.now(); carry = 0;
    if (on) requestAnimationFrame(tick);
  };
  button.addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => { play(false); at = Number(slider.value); draw(); });
  for (const jump of document.querySelectorAll("[data-jump]"))
    jump.addEventListener("click", () => { play(false); at = Math.round(Number(jump.dataset.jump) / data.every); draw(); });
  addEventListener("resize", draw);
  addEventListener("beforeprint", draw);
  draw();
})();
