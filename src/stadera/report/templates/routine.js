// Plays the motion as lines, from the side and from the front.
(() => {
  const { lines, interval } = JSON.parse(document.getElementById("film-data").textContent);
  const canvas = document.getElementById("film"), pen = canvas.getContext("2d");
  const all = lines.flat(2), span = (k) => [Math.min(...all.map((p) => p[k])), Math.max(...all.map((p) => p[k]))];
  const [x, y, z] = [span(0), span(1), span(2)], half = canvas.width / 2;
  const scale = 0.8 * Math.min(half / Math.max(x[1] - x[0], y[1] - y[0]), canvas.height / (z[1] - z[0]));
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name);
  const draw = (k) => {
    pen.clearRect(0, 0, canvas.width, canvas.height);
    [[0, x, "side"], [1, y, "front"]].forEach(([axis, range, name], view) => {
      const at = (p) => [half * (view + 0.5) + scale * (p[axis] - (range[0] + range[1]) / 2),
        canvas.height * 0.92 - scale * (p[2] - z[0])];
      pen.strokeStyle = colour("line");
      pen.lineWidth = 2;
      pen.beginPath();
      pen.moveTo(half * view + 20, canvas.height * 0.92);
      pen.lineTo(half * (view + 1) - 20, canvas.height * 0.92);
      pen.stroke();
      lines.forEach((pictures, which) => {
        pen.strokeStyle = colour(which === lines.length - 1 ? "orange" : "blue");
        pen.lineWidth = which === lines.length - 1 ? 8 : 5;
        pen.beginPath();
        pictures[k].forEach((p, i) => pen[i ? "lineTo" : "moveTo"](...at(p)));
        pen.stroke();
      });
      pen.fillStyle = colour("soft");
      pen.font = "22px system-ui";
      pen.fillText(name, half * view + 24, 30);
    });
  };
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const count = lines[0].length;
  const step = (now) => {
    draw(Math.floor(now / 1000 / interval) % count);
    if (!still) requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})();
