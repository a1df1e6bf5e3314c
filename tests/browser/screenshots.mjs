// The screenshots of README.md and docs, from a server on which the quickstart has ended:
//
//     torqued quickstart                                                     # and in another terminal:
//     node tests/browser/screenshots.mjs http://127.0.0.1:7070

import { launch } from "./chromium.mjs";

const [server] = process.argv.slice(2);
const get = async (path) => (await fetch(server + path)).json();

const { evaluations } = await get("/v1/evaluations");
const evaluation = evaluations.find((it) => it.state === "succeeded");
const { checkpoints } = await get("/v1/checkpoints");
const best = ["lagrangian", "robomorph"].map((architecture) =>
  checkpoints.find((it) => it.architecture === architecture && it.final).id);
const { datasets } = await get("/v1/datasets");
const test = datasets.find((it) => it.name === "test-grid").id;

/** The page and the height of the window. */
const shots = {
  evaluation: [`/evaluations/${evaluation.id}`, 1600],
  predictions: [`/predict?dataset=${test}&trajectory=82&checkpoint=${best}`, 1340],
};

const browser = await launch();
for (const [name, [path, height]] of Object.entries(shots)) {
  const page = await browser.newPage({ viewport: { width: 1180, height }, colorScheme: "light" });
  await page.goto(server + path);
  await page.evaluate(() => Promise.all([...document.images].filter((it) => it.loading !== "lazy").map((it) => it.decode())));
  await page.screenshot({ path: new URL(`../../docs/figures/${name}.png`, import.meta.url).pathname });
  await page.close();
}
await browser.close();
