// Answers forms as they are changed: those with `data-answers`, the ids of the parts of the page that follow from them. A
// number with `data-slider`, its highest value, gets a slider in the place that follows its label. A field with `data-whole` changes the whole page. Without this
// script, the form's button does the same.

import { fetched, replace } from "./replace.js";

const WAIT = 200; // A slider that moves asks when it rests.

let asked = 0;
let timer;

// Fields may be called like properties of their form, such as `dataset`, and would be found in their place.
const attribute = (form, name) => form.getAttribute(name);

async function answer(form) {
  if (!form.checkValidity()) return;
  const address = new URL(attribute(form, "action"), location);
  address.search = new URLSearchParams(new FormData(form)).toString();
  const mine = ++asked;
  const parts = attribute(form, "data-answers").split(" ").map((id) => document.getElementById(id));
  parts.forEach((part) => part?.setAttribute("aria-busy", "true"));
  let page;
  try {
    page = await fetched(address);
  } catch (error) {
    if (mine !== asked) return;
    // The server says what is wrong on a page of its own. Without an answer, the button asks again.
    if (error.cause) location.assign(address);
    else parts.forEach((part) => part?.removeAttribute("aria-busy"));
    return;
  }
  if (mine !== asked) return;
  for (const stale of parts) {
    const fresh = stale && page.getElementById(stale.id);
    if (fresh) replace(stale, fresh);
  }
  document.title = page.title;
  history.replaceState(null, "", address);
}

function soon(form) {
  clearTimeout(timer);
  timer = setTimeout(answer, WAIT, form);
}

function addSlider(number) {
  const slider = document.createElement("input");
  slider.type = "range";
  slider.className = "added";
  [slider.min, slider.max, slider.step] = [number.min, number.dataset.slider, number.step];
  slider.value = number.value || number.min;
  slider.setAttribute("aria-label", number.closest("label").textContent.trim());
  slider.addEventListener("input", () => {
    number.value = slider.value;
    soon(number.form);
  });
  number.addEventListener("input", () => (slider.value = number.value || number.min));
  number.closest("label").nextElementSibling.append(slider);
}

for (const form of document.querySelectorAll("form[data-answers]")) {
  form.querySelectorAll("input[data-slider]").forEach(addSlider);
  form.addEventListener("change", (event) => {
    if ("whole" in event.target.dataset) HTMLFormElement.prototype.submit.call(form);
    else if (event.target.type !== "range") soon(form);
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    clearTimeout(timer);
    answer(form);
  });
}
