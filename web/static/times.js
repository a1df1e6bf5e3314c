// Shows moments in the reader's time zone. The server writes them in UTC, as does a page without scripts.

const two = (number) => String(number).padStart(2, "0");

/** "+01", "-03:30": what the clock of the reader is ahead of UTC at that moment. */
function zone(moment) {
  const ahead = -moment.getTimezoneOffset();
  const [hours, minutes] = [Math.floor(Math.abs(ahead) / 60), Math.abs(ahead) % 60];
  return `${ahead < 0 ? "-" : "+"}${two(hours)}${minutes ? `:${two(minutes)}` : ""}`;
}

function local(moment) {
  const date = [moment.getFullYear(), two(moment.getMonth() + 1), two(moment.getDate())].join("-");
  const time = [moment.getHours(), moment.getMinutes(), moment.getSeconds()].map(two).join(":");
  return `${date} ${time} ${zone(moment)}`;
}

/** Shows the moments of a part of the page in local time, and keeps what the server wrote as their title. */
export function localize(part) {
  for (const shown of part.querySelectorAll("time[datetime]:not([title])")) {
    const moment = new Date(shown.dateTime);
    if (Number.isNaN(moment.getTime()) || moment.getTimezoneOffset() === 0) continue;
    shown.title = shown.textContent;
    shown.textContent = local(moment);
  }
}

/** Puts back what the server wrote in a copy of a part. */
export function asWritten(copy) {
  for (const shown of copy.querySelectorAll("time[title]")) {
    shown.textContent = shown.title;
    shown.removeAttribute("title");
  }
}
