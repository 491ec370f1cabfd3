// The files of the last plan, one by one or all in a zip. Of a refused plan there is no program among them.

import { zipSync } from "fflate";
import { el } from "../../src/dom.js";
import { WORDS } from "../../src/texts.js";

const address = (name) => `file?name=${name}`;

export class Files {
  // `tell(words)` says what could not be saved.
  constructor(tell) {
    this.tell = tell;
    this.names = "";
    this.list = el("ul", {});
    this.zip = el("button", { type: "button", id: "zip", title: WORDS.zipHint, onclick: () => this.saveAll() }, WORDS.zip);
    this.box = el("details", { id: "files", class: "files popup", hidden: true }, el("summary", {}, WORDS.files), el("div", { class: "unfolded" }, this.list, this.zip));
  }

  show({ files }) {
    this.box.hidden = !files.length;
    if (this.names === files.join()) return;
    this.names = files.join();
    this.files = files;
    this.list.replaceChildren(...files.map((name) => el("li", {}, el("a", { href: address(name), download: name }, name), " ", el("span", { class: "soft" }, WORDS.fileKinds[name] ?? ""))));
  }

  async saveAll() {
    const contents = {};
    for (const name of this.files) {
      const answer = await fetch(address(name)).catch(() => null);
      if (!answer?.ok) {
        this.tell(answer ? await answer.text() : WORDS.gone);
        return;
      }
      contents[name] = new Uint8Array(await answer.arrayBuffer());
    }
    const blob = new Blob([zipSync(contents)], { type: "application/zip" });
    const link = el("a", { href: URL.createObjectURL(blob), download: WORDS.zipName });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }
}
