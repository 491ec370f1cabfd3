// Uses the page as a reader does, and answers with what it saw; the mouse is the test's.
(async () => {
  const answer = {};
  const $ = (id) => document.getElementById(id);
  const frames = async (n) => {
    for (let i = 0; i < n; i++) await new Promise((done) => requestAnimationFrame(done));
  };
  const change = (element, value, kind) => {
    element.value = value;
    element.dispatchEvent(new Event(kind, { bubbles: true }));
  };
  // Distinct colours, and a sum that another picture will hardly share.
  const picture = async () => {
  await frames(3);
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [360, 225];
  const context = copy.getContext("2d");
  context.drawImage($("canvas"), 0, 0, 360, 225);
  const pixels = new Uint32Array(context.getImageData(0, 0, 360, 225).data.buffer);
  let sum = 0;
  for (const pixel of pixels) sum = (Math.imul(sum, 31) + pixel) >>> 0;
  return { colours: new Set(pixels).size, drawn: pixels.filter((p) => p !== 0).length / pixels.length, sum };
  };
  const torch = () => weldpath.scene.groups.torch.position.toArray().map((v, k) => v + weldpath.content.centre_mm[k]);
  const key = (name, target) => target.dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true, cancelable: true }));
  await frames(3);
  answer.title = $("title").textContent;
  answer.inputs = $("facts").textContent;
  answer.charts = document.querySelectorAll("svg.chart").length;
  answer.figures = [...document.querySelectorAll("#charts h2")].map((h) => h.textContent);
  answer.warnings = [...document.querySelectorAll("#warnings li")].map((li) => li.textContent);
  answer.strange = document.querySelectorAll("#title *, #seams img, #facts img, script[src], link[href^=http]").length;
  answer.unnamed = [...document.querySelectorAll("button, input, select")]
    .filter((e) => !(e.textContent.trim() || e.getAttribute("aria-label") || e.closest("label")?.textContent.trim())).length;
  if (typeof weldpath !== "undefined" && weldpath.scene) {
    answer.first = await picture();
    answer.pictures = [];
    for (const k of [0, 1, 2, 3, 4, 5]) {
      change($("colour-by"), String(k), "change");
      answer.pictures.push((await picture()).sum);
      answer.legend = (answer.legend ?? []).concat($("legend").textContent);
    }
    change($("colour-by"), "0", "change");
    for (const cloud of ["unfiltered", "raw", "model"]) {
      change($("cloud"), cloud, "change");
      answer.pictures.push((await picture()).sum);
    }
    const slider = $("slider");
    answer.torch = [];
    for (const share of [0, 0.5, 1]) {
      change(slider, String(share * Number(slider.max)), "input");
      answer.torch.push(torch());
    }
    answer.slider = [$("readout").textContent, slider.getAttribute("aria-valuetext")];

    document.querySelector('#seams tr[data-seam="2"] button').click();
    answer.fromList = $("detail").textContent;
    document.querySelector('#labels button').click();
    answer.fromLabel = $("detail").textContent;
    key("2", $("canvas"));
    answer.fromKey = weldpath.state.seam;

    change(slider, "0", "input");
    change($("rate"), "1", "change");
    $("play").click();
    await frames(4);
    answer.played_s = weldpath.state.time_s;
    key(" ", document.body);
    answer.paused = !weldpath.state.playing;

    const before = weldpath.scene.camera.position.toArray().join();
    key("ArrowLeft", $("canvas"));
    answer.turned = before !== weldpath.scene.camera.position.toArray().join();

    // Everything at once, turning.
    for (const box of document.querySelectorAll("#tools input")) if (!box.checked) box.click();
    const times = [];
    for (let i = 0; i < 12; i++) {
      weldpath.scene.turn(0.05, 0);
      await frames(2);
      times.push(weldpath.scene.stats.script_ms);
    }
    times.sort((a, b) => a - b);
    answer.script_ms = [times[6], times[11]];
    answer.drawCalls = weldpath.scene.stats.drawCalls;
    answer.points = weldpath.scene.stats.points;
    const still = weldpath.scene.stats.frames;
    await frames(10);
    answer.idleFrames = weldpath.scene.stats.frames - still;
    $("theme").click();
    answer.theme = document.documentElement.dataset.theme;
  }
  return answer;
})();
