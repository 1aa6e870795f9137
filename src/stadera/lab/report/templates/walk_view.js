// The demo's scene: both robots side by side, moved by their films, drawn by three.js in the page's colours.
(() => {
  const data = JSON.parse(document.getElementById("walks").textContent), T = THREE;
  const $ = (id) => document.getElementById(id), stage = $("stage");
  const slider = $("moment"), button = $("play"), clock = $("clock"), speed = $("speed");

  // -- films: frames as rows of numbers, NaN for what is not there
  const films = data.runs.map((run) => {
    const raw = new DataView(Uint8Array.from(atob(run.data), (c) => c.charCodeAt(0)).buffer), width = run.low.length;
    const at = {};
    let column = 0;
    for (const [name, count] of Object.entries(run.widths)) { at[name] = [column, count]; column += count; }
    const frame = (k) => Array.from({length: width}, (_, c) => {
      const v = raw.getInt16(2 * (k * width + c), true);
      return v === -32768 ? NaN : run.low[c] + (v + 32767) * run.step[c];
    });
    const rows = Array.from({length: run.frames}, (_, k) => frame(k));
    const end = run.begin + (run.frames - 1) * run.every;
    const get = (time, name) => {  // between two frames; what is there in only one of them as it is there
      const s = Math.min(Math.max((time - run.begin) / run.every, 0), run.frames - 1);
      const k = Math.min(Math.floor(s), run.frames - 2), share = s - k, [from, count] = at[name];
      return Array.from({length: count}, (_, c) => {
        const a = rows[k][from + c], b = rows[k + 1][from + c];
        return isNaN(a) ? (share > 0.5 ? b : a) : isNaN(b) ? a : a + share * (b - a);
      });
    };
    return {...run, end, get};
  });
  const begin = Math.min(...films.map((f) => f.begin)), end = Math.max(...films.map((f) => f.end));

  let renderer;
  try { renderer = new T.WebGLRenderer({antialias: true}); } catch { stage.textContent = "This scene needs WebGL, which the browser does not offer."; stage.classList.add("off"); return; }
  stage.prepend(renderer.domElement);
  renderer.domElement.setAttribute("aria-label", stage.dataset.label);
  renderer.domElement.setAttribute("role", "img");
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = T.PCFSoftShadowMap;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));

  // -- what things are made of; colours follow the page's, light or dark
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const solid = (roughness = 0.55, metalness = 0.15) => new T.MeshStandardMaterial({roughness, metalness});
  const flat = (opacity = 1, over = false) => new T.MeshBasicMaterial({transparent: opacity < 1 || over, opacity, depthTest: !over, depthWrite: opacity === 1 && !over, side: T.DoubleSide});
  const faceted = (roughness, metalness) => Object.assign(solid(roughness, metalness), {flatShading: true, side: T.DoubleSide});
  const paint = {shell: faceted(0.5, 0.3), leg: faceted(0.65, 0.1), plate: solid(0.7), hot: solid(), foot: solid(0.9, 0), box: solid(0.6), ground: solid(1, 0),
    lines: new T.LineBasicMaterial(), force: flat(), truth: flat(1, true), model: flat(1, true), inside: flat(0.4), outside: flat(0.55), drop: new T.LineBasicMaterial()};
  const scene = new T.Scene(), sky = new T.HemisphereLight(), sun = new T.DirectionalLight();
  const recolour = () => {
    const night = dark.matches;
    scene.background = new T.Color(css("ground"));
    const set = (name, colour) => paint[name].color.set(colour);
    for (const [name, colour] of Object.entries({shell: "shell", leg: "limb", foot: "foot", box: "box"})) set(name, css(colour));
    set("plate", night ? "#5b6878" : "#aab4c1"); set("ground", night ? "#1d232b" : "#e9ecf0");
    set("lines", css("line")); set("force", css("steel")); set("truth", css("ink")); set("drop", css("ink")); set("model", css("blue")); set("inside", css("green")); set("outside", css("red"));
    set("hot", "#ff2d20"); paint.hot.emissive.set("#d01408");
    sky.color.set(night ? "#c4d4ea" : "#ffffff"); sky.groundColor.set(night ? "#20262e" : "#b9bfc8");
    sky.intensity = night ? 2.2 : 1.7; sun.intensity = night ? 2.0 : 2.4;
  };

  // -- the ground, lit from the left and above
  const mesh = (geometry, material, place, shadow = true) => {
    const made = new T.Mesh(geometry, material);
    made.castShadow = made.receiveShadow = shadow;
    place.add(made);
    return made;
  };
  scene.add(sky, sun, sun.target);
  sun.castShadow = true;
  sun.shadow.mapSize.set(1024, 1024);
  Object.assign(sun.shadow.camera, {left: -2.6, right: 2.6, top: 2.6, bottom: -2.6, far: 12});
  sun.shadow.bias = -0.0005; sun.shadow.normalBias = 0.02;
  mesh(new T.PlaneGeometry(60, 60), paint.ground, scene).castShadow = false;
  const marks = [];
  for (let x = -4; x <= 8; x += 0.5) marks.push(x, -2.2, 0.001, x, 2.2, 0.001);
  for (const y of [-2.2, 0, 2.2]) marks.push(-4, y, 0.001, 8, y, 0.001);
  const lines = (points, material, place) => {
    const geometry = new T.BufferGeometry();
    geometry.setAttribute("position", new T.Float32BufferAttribute(points, 3));
    const made = new T.LineSegments(geometry, material);
    made.frustumCulled = false;
    place.add(made);
    return made;
  };
  lines(marks, paint.lines, scene);

  // -- a robot: a group a link, inside its parent's
  const UP = new T.Vector3(0, 1, 0), vector = (v) => new T.Vector3(...v);
  const numbers = (text) => new Uint16Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const meshes = Object.fromEntries(Object.entries(data.robot.meshes).map(([name, {low, step, corners, faces}]) => {
    const geometry = new T.BufferGeometry();
    geometry.setAttribute("position", new T.Float32BufferAttribute(Float32Array.from(numbers(corners), (v, k) => low[k % 3] + step[k % 3] * v), 3));
    geometry.setIndex([...numbers(faces)]);
    geometry.computeVertexNormals();
    return [name, geometry];
  }));
  const robot = (place) => {
    const trunk = new T.Group(), links = [trunk], turns = [], drives = [];
    place.add(trunk);
    for (const joint of data.robot.joints) {
      const fixed = new T.Group(), turn = new T.Group();
      fixed.position.set(...joint.at); fixed.quaternion.set(...joint.turn);
      links[joint.parent].add(fixed); fixed.add(turn);
      links.push(turn); turns.push({turn, axis: vector(joint.axis)});
    }
    for (const part of data.robot.parts) {
      const link = links[part.link];
      if (part.kind === "mesh") {
        const shell = mesh(meshes[part.mesh], paint[part.joint === undefined ? "shell" : "leg"], link);
        shell.position.set(...part.at); shell.quaternion.set(...part.turn);
        if (part.joint !== undefined) drives[part.joint] = shell;
      }
      else if (part.kind === "foot") mesh(new T.SphereGeometry(part.radius, 24, 16), paint.foot, link).position.set(...part.at);
      else {
        const block = mesh(new T.RoundedBoxGeometry(...part.size, 5, 0.4 * Math.min(...part.size)), paint.plate, link);
        block.position.set(...part.at);
      }
    }
    return {trunk, turns, drives, cold: drives.map((drive) => drive.material)};
  };
  const arrow = (place) => {
    const group = new T.Group();
    const shaft = mesh(new T.CylinderGeometry(0.011, 0.011, 1, 12).translate(0, 0.5, 0), paint.force, group, false);
    const tip = mesh(new T.ConeGeometry(0.028, 0.07, 16).translate(0, 0.035, 0), paint.force, group, false);
    place.add(group);
    return (at, force) => {
      const length = 0.9 * Math.hypot(...force) / data.weight;
      group.visible = length > 0.01;
      if (!group.visible) return;
      group.position.set(...at);
      group.quaternion.setFromUnitVectors(UP, vector(force).normalize());
      shaft.scale.y = length; tip.position.y = length;
    };
  };

  const LANE = 0.78;
  const actors = films.map((film, k) => {
    const lane = new T.Group();
    lane.position.y = k ? LANE : -LANE;
    scene.add(lane);
    const body = robot(lane), arrows = [0, 1, 2, 3].map(() => arrow(lane));
    const box = mesh(new T.RoundedBoxGeometry(...data.box, 3, 0.012), paint.box, lane);
    const ground = mesh(new T.BufferGeometry(), paint.inside, lane, false), drop = lines([0, 0, 0, 0, 0, 0], paint.drop, lane);
    ground.frustumCulled = false;
    const dot = (geometry, material, order) => { const made = mesh(geometry, material, lane, false); made.renderOrder = order; return made; };
    const truth = dot(new T.CircleGeometry(0.034, 32), paint.truth, 3), model = dot(new T.RingGeometry(0.05, 0.072, 40), paint.model, 2);
    const label = document.createElement("p");
    label.className = "label";
    label.innerHTML = "<strong></strong><span></span>";
    label.firstChild.textContent = film.name;
    stage.append(label);
    return {film, lane, ...body, arrows, box, ground, drop, truth, model, label, told: label.lastChild};
  });

  const polygon = (points) => {  // a convex corner list, counter-clockwise
    const p = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]), half = (list) => {
      const h = [];
      for (const q of list) {
        while (h.length > 1 && (h.at(-1)[0] - h.at(-2)[0]) * (q[1] - h.at(-2)[1]) <= (h.at(-1)[1] - h.at(-2)[1]) * (q[0] - h.at(-2)[0])) h.pop();
        h.push(q);
      }
      return h.slice(0, -1);
    };
    return [...half(p), ...half([...p].reverse())];
  };
  const pose = (group, p) => { group.position.set(p[0], p[1], p[2]); group.quaternion.set(p[3], p[4], p[5], p[6]).normalize(); };
  const show = (actor, time) => {
    const {film} = actor, get = (name) => film.get(time, name), feet = get("feet"), force = get("force"), down = get("down");
    pose(actor.trunk, get("trunk"));
    get("joints").forEach((angle, j) => actor.turns[j].turn.quaternion.setFromAxisAngle(actor.turns[j].axis, angle));
    get("limited").forEach((share, j) => { if (actor.drives[j]) actor.drives[j].material = share > 0.5 ? paint.hot : actor.cold[j]; });
    const box = get("box");
    actor.box.visible = !isNaN(box[0]);
    if (actor.box.visible) pose(actor.box, box);
    const foot = (k) => feet.slice(3 * k, 3 * k + 3), standing = [0, 1, 2, 3].filter((k) => down[k] > 0.5).map(foot);
    actor.arrows.forEach((draw, k) => draw(foot(k), force.slice(3 * k, 3 * k + 3)));
    const corners = standing.length > 2 ? polygon(standing) : [], margin = get("margin")[0];
    const fan = corners.slice(2).flatMap((_, k) => [corners[0], corners[k + 1], corners[k + 2]].flatMap(([x, y]) => [x, y, 0.004]));
    actor.ground.geometry.setAttribute("position", new T.Float32BufferAttribute(fan, 3));
    actor.ground.material = margin < 0 ? paint.outside : paint.inside;
    const com = get("com"), model = get("model");
    actor.truth.position.set(com[0], com[1], 0.007); actor.model.position.set(model[0], model[1], 0.006);
    actor.drop.geometry.setAttribute("position", new T.Float32BufferAttribute([...com, com[0], com[1], 0.007], 3));
    const event = film.events.filter((e) => e.time <= time + 1e-6).at(-1) ?? film.events[0];
    actor.told.textContent = event.text;
    actor.label.className = `label ${event.level}`;
    return com;
  };

  // -- the camera goes along; turning, moving and zooming it is the reader's
  const camera = new T.PerspectiveCamera(30, 1, 0.1, 60), orbit = new T.OrbitControls(camera, renderer.domElement);
  camera.up.set(0, 0, 1);
  orbit.enablePan = false; orbit.maxPolarAngle = 1.5; orbit.minDistance = 1.5; orbit.maxDistance = 12;
  orbit.enableZoom = false;  // the wheel scrolls the page until the scene was touched
  renderer.domElement.addEventListener("pointerdown", () => { orbit.enableZoom = true; });
  let ahead = 0;
  const place = () => {
    const {clientWidth: w, clientHeight: h} = stage;
    if (!w || !h) return;
    renderer.setSize(w, h, false);
    camera.aspect = w / h;
    const tall = Math.tan((camera.fov * Math.PI) / 360), distance = Math.max(0.98 / tall, 1.5 / (tall * camera.aspect));
    orbit.target.set(ahead, 0, 0.36);
    camera.position.copy(orbit.target).add(new T.Vector3(0.78, 0.45, 0.46).normalize().multiplyScalar(distance));
    camera.updateProjectionMatrix(); orbit.update();
  };
  const follow = (x) => {
    camera.position.x += x - ahead; orbit.target.x += x - ahead; ahead = x;
    sun.target.position.set(x, 0, 0); sun.position.set(x + 1.6, -2.2, 5.5);
  };
  const toScreen = new T.Vector3();
  const letter = (actor) => {
    const {clientWidth: w, clientHeight: h} = stage, half = actor.label.offsetWidth / 2;
    if (w < 600) { actor.label.style.transform = `translate(${actor.lane.position.y < 0 ? 6 : w - 2 * half - 6}px, 6px)`; return; }
    toScreen.copy(actor.trunk.position).add(actor.lane.position);
    toScreen.z = 1.02;
    toScreen.project(camera);
    const x = Math.min(Math.max(((toScreen.x + 1) / 2) * w, half + 6), w - half - 6), y = Math.max(((1 - toScreen.y) / 2) * h, actor.label.offsetHeight + 6);
    actor.label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -100%)`;
  };

  // -- time
  let now = begin, playing = false, last = 0, rest = 0;
  const draw = () => {
    const places = actors.map((actor) => show(actor, Math.min(now, actor.film.end)));
    follow(0.25 * places[0][0] + 0.75 * places[1][0]);
    orbit.update();
    renderer.render(scene, camera);
    actors.forEach(letter);
    slider.value = now;
    const since = now - data.load;
    clock.textContent = `${since < 0 ? "−" : "+"}${Math.abs(since).toFixed(1)} s`;
    slider.setAttribute("aria-valuetext", `${since.toFixed(1)} s from the box on`);
  };
  const tick = (time) => {
    if (!playing) return;
    const dt = Math.min(Math.max((time - last) / 1000, 0), 0.1);  // a first frame may be stamped before `last`
    last = time;
    if (now >= end && (rest += dt) > 1.8) { now = begin; rest = 0; }
    else now = Math.min(now + dt * Number(speed.value), end);
    draw();
    requestAnimationFrame(tick);
  };
  const play = (on) => {
    playing = on; rest = 0; last = performance.now();
    if (on && now >= end) now = begin;
    button.textContent = on ? "Pause" : "Play";
    if (on) requestAnimationFrame(tick);
  };
  const jump = (time) => { play(false); now = Math.min(Math.max(time, begin), end); draw(); };
  slider.min = begin; slider.max = end; slider.step = 0.02;
  button.addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => jump(Number(slider.value)));
  for (const moment of document.querySelectorAll("[data-jump]")) moment.addEventListener("click", () => jump(Number(moment.dataset.jump)));
  orbit.addEventListener("change", () => { if (!playing) { renderer.render(scene, camera); actors.forEach(letter); } });
  dark.addEventListener("change", () => { recolour(); draw(); });
  new ResizeObserver(() => { place(); draw(); }).observe(stage);
  recolour(); place(); draw();
  const asked = Number(new URLSearchParams(location.hash.slice(1)).get("t"));  // #t=4.7 stands still there
  if (asked) jump(asked); else play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
})();
