// Replaces parts of the page by fresh ones of the server.

import { carryOn, states } from "./charts.js";
import { localize } from "./times.js";

const REQUEST_TIMEOUT = 15000;

/** The answer to a reader whose login has expired: the page at `address`, where one logs in again. */
export class LoggedOut extends Error {
  constructor(address) {
    super("the login has expired", { cause: 401 });
    this.address = address;
  }
}

/** The page at an address, as the server has it now. The cause of an error is the status, if there was an answer. */
export async function fetched(address) {
  const response = await fetch(address, {
    headers: { accept: "text/html" },
    cache: "no-store",
    signal: AbortSignal.timeout(REQUEST_TIMEOUT),
  });
  if (!response.ok) throw new Error(`the server answered ${response.status}`, { cause: response.status });
  if (response.redirected && new URL(response.url).pathname.endsWith("/login")) throw new LoggedOut(response.url);
  return new DOMParser().parseFromString(await response.text(), "text/html");
}

/**
 * Puts `fresh` in the place of `stale`, keeping what the reader opened and ticked, how far it is scrolled and where the
 * focus is.
 */
export function replace(stale, fresh) {
  for (const details of stale.querySelectorAll("details[id][open]")) {
    fresh.querySelector(`#${CSS.escape(details.id)}`)?.setAttribute("open", "");
  }
  const focused = stale.contains(document.activeElement) ? document.activeElement.id : "";
  const scrolled = [...stale.querySelectorAll(".scroll")].map((region) => region.scrollLeft);
  const read = [...stale.querySelectorAll(".tail")].map((log) => log.scrollTop);
  const checked = [...stale.querySelectorAll("input[type=checkbox][id]:checked")];
  const shown = document.importNode(fresh, true);
  const drawn = states(stale);
  localize(shown);
  stale.replaceWith(shown);
  carryOn(shown, drawn);
  shown.querySelectorAll(".scroll").forEach((region, at) => (region.scrollLeft = scrolled[at] ?? 0));
  shown.querySelectorAll(".tail").forEach((log, at) => (log.scrollTop = read[at] ?? 0));
  for (const { id } of checked) {
    const box = document.getElementById(id);
    if (box) box.checked = true;
  }
  if (focused) document.getElementById(focused)?.focus();
  document.dispatchEvent(new Event("replaced"));
}
