// Plays the motion as lines, from the side and from the front.
(() => {
  const { lines, interval } = JSON.parse(document.getElementById("film-data").textContent);
  const views = [...document.querySelectorAll(".film")].map((canvas) => canvas.getContext("2d"));
  const all = lines.flat(2), span = (k) => [Math.min(...all.map((p) => p[k])), Math.max(...all.map((p) => p[k]))];
  const ranges = [span(0), span(1), span(2)], { width, height } = views[0].canvas;
  const scale = 0.85 * Math.min(...ranges.map(([low, high], k) => (k < 2 ? width : height) / (high - low)));
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name);
  const ground = height * 0.95, trunk = lines.length - 1;
  const draw = (k) => views.forEach((pen, axis) => {
    const middle = (ranges[axis][0] + ranges[axis][1]) / 2;
    const at = (p) => [width / 2 + scale * (p[axis] - middle), ground - scale * (p[2] - ranges[2][0])];
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = colour("line");
    pen.fillRect(0, ground, width, 3);
    pen.lineJoin = pen.lineCap = "round";
    lines.forEach((pictures, which) => {
      pen.strokeStyle = pen.fillStyle = colour(which === trunk ? "orange" : "blue");
      pen.lineWidth = which === trunk ? 16 : 9;
      pen.beginPath();
      pictures[k].forEach((p, i) => pen[i ? "lineTo" : "moveTo"](...at(p)));
      pen.stroke();
      if (which === trunk) pen.fill();
    });
  });
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const count = lines[0].length;
  const step = (now) => {
    draw(Math.floor(now / 1000 / interval) % count);
    if (!still) requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})();
