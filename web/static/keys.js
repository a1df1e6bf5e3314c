// Shortcuts of the keyboard, and a window that lists them. A link of the main navigation says its letter in `data-key`. Whoever
// speaks to the browser, or types with one finger, can switch them off there: the browser remembers it.

const OFF = "shortcuts-off";
const PATIENCE = 1500; // Milliseconds from `g` to the letter of a page.

let leads = false;
let timer;

const pages = () => [...document.querySelectorAll("nav [data-key]")];
// The first link of each row of a list, or of each experiment.
const rows = () => [...document.querySelectorAll("td.name > a, .experiment h2 a")];

function move(by) {
  const all = rows();
  if (!all.length) return;
  const at = all.findIndex((it) => it.closest("tr, .experiment")?.contains(document.activeElement));
  const next = all[at < 0 ? (by > 0 ? 0 : all.length - 1) : Math.min(Math.max(at + by, 0), all.length - 1)];
  next.focus();
  next.scrollIntoView({ block: "nearest" });
}

function tick() {
  const box = document.activeElement?.closest("tr")?.querySelector("[type=checkbox]");
  if (box) box.click();
}

const KEYS = {
  "/": ["search on this page", () => document.querySelector("[type=search]")?.focus()],
  j: ["the next of a list", () => move(1)],
  k: ["the one before it", () => move(-1)],
  x: ["tick it, to compare", tick],
  c: ["compare what is ticked", () => document.querySelector("form.compared [type=submit]")?.click()],
  "?": ["show these shortcuts", () => show()],
};

function listed() {
  const keys = Object.entries(KEYS).map(([key, [words]]) => [[key], words]);
  const go = pages().map((link) => [["g", link.dataset.key], link.textContent]);
  return [...keys, ...go];
}

function show() {
  const open = document.querySelector("dialog.keys");
  if (open) return open.close();
  const dialog = document.createElement("dialog");
  dialog.className = "keys";
  dialog.setAttribute("aria-labelledby", "keys-title");
  const title = Object.assign(document.createElement("h2"), { id: "keys-title", textContent: "Shortcuts" });
  const list = document.createElement("dl");
  for (const [keys, words] of listed()) {
    const row = document.createElement("div");
    const term = document.createElement("dt");
    term.append(...keys.map((key) => Object.assign(document.createElement("kbd"), { textContent: key })));
    row.append(term, Object.assign(document.createElement("dd"), { textContent: words }));
    list.append(row);
  }
  const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: !localStorage.getItem(OFF) });
  box.addEventListener("change", () => (box.checked ? localStorage.removeItem(OFF) : localStorage.setItem(OFF, "1")));
  const label = document.createElement("label");
  label.append(box, " Shortcuts are on in this browser");
  const close = Object.assign(document.createElement("button"), { textContent: "Close", className: "plain", type: "button" });
  close.addEventListener("click", () => dialog.close());
  dialog.addEventListener("close", () => dialog.remove());
  dialog.append(title, list, label, close);
  document.body.append(dialog);
  dialog.showModal();
}

function isTyping(target) {
  return target.closest("input, textarea, select, [contenteditable]") && !/^(checkbox|radio|button|submit)$/.test(target.type);
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || isTyping(event.target)) return;
  if (localStorage.getItem(OFF)) return;
  if (document.querySelector("dialog[open]") && event.key !== "?") return;
  clearTimeout(timer);
  const goesOn = leads;
  leads = false;
  if (goesOn) {
    const link = pages().find((it) => it.dataset.key === event.key);
    if (!link) return;
    event.preventDefault();
    location.assign(link.href);
  } else if (event.key === "g") {
    leads = true;
    timer = setTimeout(() => (leads = false), PATIENCE);
  } else if (Object.hasOwn(KEYS, event.key)) {
    event.preventDefault();
    KEYS[event.key][1]();
  }
});

const hint = Object.assign(document.createElement("button"), { className: "link", type: "button", textContent: "Shortcuts" });
hint.addEventListener("click", show);
document.querySelector("footer .frame")?.append(" · ", hint);
