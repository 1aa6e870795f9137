// Plays the motion: parts of the robot as outlines, from the side and from the front, between pictures linearly.
(() => {
  const { views, interval, count } = JSON.parse(document.getElementById("film-data").textContent);
  const pens = [...document.querySelectorAll(".film")].map((canvas) => canvas.getContext("2d"));
  const decoded = (text) => new Int16Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  const points = views.map((view) => decoded(view.corners)), { width, height } = pens[0].canvas;
  const span = (of, k) => of.reduce((s, v, i) => (i % 2 === k ? [Math.min(s[0], v), Math.max(s[1], v)] : s), [1e5, -1e5]);
  const across = points.map((of) => span(of, 0)), up = span(points[0], 1), ground = height * 0.95;
  const sizes = [...across.map((s) => width / (s[1] - s[0])), height / (up[1] - up[0])], scale = 0.9 * Math.min(...sizes);
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name);
  const draw = (at) => pens.forEach((pen, which) => {
    const { colours } = views[which], all = points[which], size = all.length / count, corners = size / colours.length;
    const k = Math.floor(at) % count, share = k < count - 1 ? at % 1 : 0, middle = (across[which][0] + across[which][1]) / 2;
    const value = (i) => all[k * size + i] + (share && share * (all[(k + 1) * size + i] - all[k * size + i]));
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = colour("line");
    pen.fillRect(0, ground, width, 3);
    colours.forEach((name, part) => {
      pen.strokeStyle = pen.fillStyle = colour(name);
      pen.beginPath();
      for (let i = part * corners; i < (part + 1) * corners; i += 2)
        pen.lineTo(width / 2 + scale * (value(i) - middle), ground - scale * (value(i + 1) - up[0]));
      pen.closePath();
      pen.globalAlpha = 0.4;
      pen.fill();
      pen.globalAlpha = 1;
      pen.stroke();
    });
  });
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const step = (now) => {
    draw(now / 1000 / interval);
    if (!still) requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})();
