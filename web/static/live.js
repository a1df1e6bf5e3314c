// Keeps the page current: fetches it again and puts in the parts that changed.
// Everything works without this script; reloading does the same.

const SHORTEST_WAIT = 1500;
const LONGEST_WAIT = 30000;
const REQUEST_TIMEOUT = 15000;

const status = document.getElementById("liveness");
let wait = SHORTEST_WAIT;
let timer;

async function freshPage() {
  const response = await fetch(location.href, {
    headers: { accept: "text/html" },
    cache: "no-store",
    signal: AbortSignal.timeout(REQUEST_TIMEOUT),
  });
  if (!response.ok) throw new Error(`the server answered ${response.status}`);
  return new DOMParser().parseFromString(await response.text(), "text/html");
}

// Puts `fresh` in the place of `stale`, keeping what the reader opened and where the focus is.
function replace(stale, fresh) {
  for (const details of stale.querySelectorAll("details[id][open]")) {
    fresh.querySelector(`#${CSS.escape(details.id)}`)?.setAttribute("open", "");
  }
  const focused = stale.contains(document.activeElement) ? document.activeElement.id : "";
  stale.replaceWith(document.importNode(fresh, true));
  if (focused) document.getElementById(focused)?.focus();
}

function update(page) {
  let changed = false;
  for (const stale of document.querySelectorAll("[data-live]")) {
    const fresh = page.getElementById(stale.id);
    if (!fresh || fresh.isEqualNode(stale)) continue;
    // `open` is the reader's and does not count as a change.
    const comparable = stale.cloneNode(true);
    for (const details of comparable.querySelectorAll("details[open]")) {
      details.removeAttribute("open");
    }
    if (fresh.isEqualNode(comparable)) continue;
    replace(stale, fresh);
    changed = true;
  }
  return changed;
}

async function refresh() {
  try {
    const changed = update(await freshPage());
    status.className = "liveness";
    if (document.querySelector("[data-settled]")) {
      status.textContent = "";
      if (document.querySelector("[data-settled='for-good']")) return;
      wait = LONGEST_WAIT;
    } else {
      status.textContent = "live";
      wait = changed ? SHORTEST_WAIT : Math.min(wait * 1.5, LONGEST_WAIT / 3);
    }
  } catch (error) {
    wait = Math.min(wait * 2, LONGEST_WAIT);
    status.className = "liveness lost";
    status.textContent = `no answer; next try in ${Math.round(wait / 1000)} s`;
  }
  schedule();
}

function schedule() {
  clearTimeout(timer);
  if (!document.hidden) timer = setTimeout(refresh, wait);
}

document.addEventListener("visibilitychange", () => {
  wait = SHORTEST_WAIT;
  schedule();
});

if (document.querySelector("[data-live]")) schedule();
