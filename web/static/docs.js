// Shows the server's own document in Swagger UI, and gives names and keyboard access to those of its elements that lack
// them.

const operations = document.getElementById("operations");
const dark = matchMedia("(prefers-color-scheme: dark)");
const follow = () => document.documentElement.classList.toggle("dark-mode", dark.matches);
dark.addEventListener("change", follow);
follow();

/** The name of a field: its parameter or property, or its part of the page. */
function nameOf(field) {
  const row = field.closest("tr");
  const named = row?.dataset.paramName ?? row?.dataset.propertyName;
  if (named) return named;
  return field.closest(".body-param, .opblock-section-request-body table") === null ? "Media type" : "Request body";
}

function repair() {
  for (const field of operations.querySelectorAll("select, textarea, input")) {
    if (!field.labels?.length && !field.ariaLabel) field.ariaLabel = nameOf(field);
  }
  for (const button of operations.querySelectorAll(".copy-to-clipboard button:not([aria-label])")) button.ariaLabel = "Copy";
  // Examples scroll sideways, which the keyboard can only do to what has the focus.
  for (const example of operations.querySelectorAll("pre:not([tabindex])")) example.tabIndex = 0;
  // A page may not have many regions of one name, and each operation has such a table.
  for (const table of operations.querySelectorAll("table[role=region]")) table.removeAttribute("role");
  // Groups of operations come right below the title, and their parts below them.
  for (const heading of operations.querySelectorAll("h3, h4")) heading.ariaLevel = heading.tagName === "H3" ? "2" : "3";
}
new MutationObserver(repair).observe(operations, { childList: true, subtree: true });

// The button that unfolds an operation contains a link to it and a button that copies its path. Screen readers cannot reach
// what is inside a button. Unfolding puts the link into the address bar.
const withoutNestedButtons = ({ React }) => ({
  components: {
    CopyToClipboardBtn: () => null,
    DeepLink: ({ text }) => React.createElement("span", null, text),
  },
});

// A proxy may show the server below a path, which the document does not know.
const root = new URL(".", location.href);
const spec = await (await fetch(new URL("v1/openapi.json", root))).json();
if (root.pathname !== "/") spec.servers = [{ url: root.pathname.replace(/\/$/, "") }];

SwaggerUIBundle({
  spec,
  dom_id: "#operations",
  deepLinking: true,
  defaultModelsExpandDepth: 0,
  plugins: [withoutNestedButtons],
  // Its colours are too faint to read, and a long example becomes thousands of elements.
  syntaxHighlight: false,
  // Nothing is asked of another machine.
  validatorUrl: null,
});
