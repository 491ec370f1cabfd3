// The server of this page: what it knows, and what it is asked to do. The address of the page holds the token.

let listener = () => {};
let revision = null;

export const onState = (call) => { listener = call; };

function take(state) {
  // An answer to a click may overtake news that was sent before it.
  if (revision !== null && state.revision < revision) return;
  revision = state.revision;
  listener(state);
}

// Does something; the words of the refusal, or nothing.
export async function act(what, body = {}) {
  const answer = await fetch(what, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
  if (!answer.ok) return answer.text();
  take(await answer.json());
  return null;
}

export const edit = (body) => act("edit", body);

// The numbers of the last plan, and of which cloud they are; null if there is none.
export async function content() {
  const answer = await fetch("content");
  return answer.ok ? answer.json() : null;
}

// The same with the element that holds its points, of whatever cloud; null if there is no report.
export async function report() {
  const answer = await fetch(location.pathname);
  if (!answer.ok) return null;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  const [numbers, points, editor] = ["content", "points", "editor"].map((id) => page.getElementById(id));
  if (!numbers || !points) return null;
  return { plan: Number(editor.dataset.plan), cloud: Number(editor.dataset.cloud), content: JSON.parse(numbers.textContent), points };
}

// The cross-section of a seam so far along it, or why there is none.
export async function section(seam, at_mm) {
  const answer = await fetch(`section?seam=${seam}&at_mm=${at_mm}`);
  return answer.ok ? answer.json() : answer.text();
}

export async function schema() {
  return (await fetch("schema")).json();
}

const RETRY_MS = 2000;

// Waits for news, for as long as the page is open.
export async function follow(onGone) {
  for (;;) {
    try {
      const answer = await fetch(revision === null ? "state" : `state?known=${revision}`);
      if (!answer.ok) throw new Error(await answer.text());
      take(await answer.json());
      onGone(false);
    } catch {
      onGone(true);
      await new Promise((done) => setTimeout(done, RETRY_MS));
    }
  }
}
