// The page before anything is open: a folder to type, or an example that is simulated.

import { $, el } from "../../src/dom.js";
import { LANGUAGE, WORDS } from "../../src/texts.js";

const said = el("p", { role: "status" });
const failed = el("p", { class: "refusal", role: "alert", hidden: true });
const input = el("input", { id: "input", type: "text", autocomplete: "off", spellcheck: "false", required: true });
const out = el("input", { id: "out", type: "text", autocomplete: "off", spellcheck: "false" });
const buttons = [
  el("button", { id: "open", title: WORDS.openHint }, WORDS.open),
  el("button", { id: "example", class: "big", type: "button", title: WORDS.exampleHint, onclick: () => choose({ choose: "example" }, WORDS.simulating) }, WORDS.example),
];

async function choose(choice, words) {
  buttons.forEach((button) => { button.disabled = true; });
  failed.hidden = true;
  said.textContent = words;
  const body = JSON.stringify({ ...choice, out: out.value.trim() || null });
  const answer = await fetch("start", { method: "POST", headers: { "content-type": "application/json" }, body }).catch(() => null);
  if (answer?.ok) {
    location.reload();
    return;
  }
  failed.textContent = answer ? await answer.text() : WORDS.gone;
  failed.hidden = false;
  said.textContent = "";
  buttons.forEach((button) => { button.disabled = false; });
}

// Another page may open something; and as long as this one asks, it is known to be open.
async function follow() {
  for (;;) {
    const answer = await fetch("state?known=0").catch(() => null);
    if (!answer?.ok) {
      failed.textContent = WORDS.gone;
      failed.hidden = false;
      return;
    }
    if ((await answer.json()).open !== false) {
      location.reload();
      return;
    }
  }
}

function form({ out: usual, example }) {
  out.placeholder = usual;
  const field = (control, label, about) => el("div", { class: "field" }, el("label", { for: control.id }, label), control, el("span", { class: "about" }, about));
  const [open, tryIt] = buttons;
  const box = el("form", { class: "card" }, tryIt, el("p", { class: "soft" }, WORDS.exampleAbout(example)),
    el("h2", {}, WORDS.openTitle),
    field(input, WORDS.input, WORDS.inputAbout), field(out, WORDS.results, WORDS.resultsAbout(usual)),
    el("div", { class: "actions" }, open), said, failed);
  box.addEventListener("submit", (event) => {
    event.preventDefault();
    choose({ choose: "input", input: input.value.trim() }, WORDS.opening);
  });
  // Escape empties the field, as a search does.
  box.addEventListener("keydown", (event) => { if (event.key === "Escape" && event.target === input) input.value = ""; });
  $("start").append(box);
  input.focus();
}

document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
document.documentElement.lang = LANGUAGE;
$("about").textContent = WORDS.startAbout;
fetch("state").then((answer) => answer.json()).then((state) => {
  if (state.open !== false) {
    location.reload();
    return;
  }
  form(state);
  follow();
});
