// Keeps what is ticked in a list of runs over orders, filters and pages, and says how many there are: in this tab of the
// browser. Without this script, the form sends what is ticked on the page.

const KEPT = "compared-runs";

const read = () => new Set(JSON.parse(sessionStorage.getItem(KEPT) ?? "[]"));
const boxes = () => [...document.querySelectorAll("form.compared .tick [name=run]")];

function keep(ticked) {
  sessionStorage.setItem(KEPT, JSON.stringify([...ticked]));
  show();
}

function show() {
  const bar = document.querySelector("form.compared .bar");
  if (!bar) return;
  const ticked = read();
  for (const box of boxes()) box.checked = ticked.has(box.value);
  bar.querySelectorAll(".added").forEach((it) => it.remove());
  document.documentElement.classList.toggle("ticked", ticked.size > 0);
  if (ticked.size === 0) return;
  const most = Number(bar.dataset.most);
  const added = (name, text) => Object.assign(document.createElement(name), { className: "added", textContent: text });
  bar.querySelector("[type=submit]").append(added("span", ` (${ticked.size})`));
  const clear = added("button", "Clear");
  clear.type = "button";
  clear.addEventListener("click", () => keep(new Set()));
  bar.append(clear);
  if (ticked.size > most) bar.append(added("span", `At most ${most} runs stand beside each other.`));
}

// A live part of the page is replaced by a fresh one, so the listeners are the document's.
document.addEventListener("change", (event) => {
  if (!event.target.matches("form.compared .tick [name=run]")) return;
  const ticked = read();
  if (event.target.checked) ticked.add(event.target.value);
  else ticked.delete(event.target.value);
  keep(ticked);
});

// The form sends those of other pages, too.
document.addEventListener("formdata", (event) => {
  if (!event.target.matches("form.compared")) return;
  const here = new Set(boxes().map((box) => box.value));
  for (const name of read()) if (!here.has(name)) event.formData.append("run", name);
});

document.addEventListener("replaced", show);
// A page that is gone back to has the ticks that its browser remembers.
addEventListener("pageshow", show);
