// The page in Chromium: its content, its requests and its downloads.

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { after, before, beforeEach, test } from "node:test";

import { launch } from "./chromium.mjs";
import { start } from "./product.mjs";

const axe = await readFile(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

let product;
let browser;
let page;
let complaints;
let strangers;

before(async () => {
  product = await start();
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await product?.stop();
});

beforeEach(async () => {
  page = await browser.newPage();
  complaints = [];
  strangers = [];
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) complaints.push(message.text());
  });
  page.on("pageerror", (error) => complaints.push(error.message));
  page.on("requestfailed", (request) => {
    // A stream of events ends only with the page, and so do requests of a page that is left.
    const isLeft = request.failure()?.errorText === "net::ERR_ABORTED";
    if (request.resourceType() !== "eventsource" && !isLeft) complaints.push(`${request.url()} failed`);
  });
  page.on("response", (response) => {
    if (response.status() >= 400) complaints.push(`${response.url()}: ${response.status()}`);
  });
  page.on("request", (request) => {
    if (new URL(request.url()).origin !== product.url) strangers.push(request.url());
  });
});

const member = (name) => product.pipeline.members.find((it) => it.name === name).job;

/** Asserts that the console has no errors and that no request went to another machine. */
function assertClean() {
  assert.deepEqual(complaints, []);
  assert.deepEqual(strangers, []);
}

test("the first page lists the experiment with its state", async () => {
  await page.goto(product.url);
  const text = await page.locator("body").innerText();
  assert.match(text, /two-models/);
  assert.match(text, /succeeded/);
  assertClean();
});

test("the page of the API shows every operation, and asks one", async () => {
  const { paths } = await product.get("/v1/openapi.json");
  const count = Object.values(paths).flatMap((path) => Object.keys(path)).length;
  await page.goto(`${product.url}/docs`);
  await page.locator(".opblock").nth(count - 1).waitFor();
  assert.equal(await page.locator(".opblock").count(), count);
  const presets = page.locator(".opblock", { hasText: "/v1/presets" });
  await presets.locator(".opblock-summary-control").click();
  await presets.getByRole("button", { name: "Try it out" }).click();
  await presets.getByRole("button", { name: "Execute" }).click();
  await presets.locator(".live-responses-table .response-col_status", { hasText: "200" }).waitFor();
  assertClean();
});

test("a run shows its loss curve", async () => {
  const { run } = await product.get(`/v1/jobs/${member("train")}`);
  await page.goto(`${product.url}/runs/${run}`);
  await assertFigureIsDrawn();
  assertClean();
});

test("an evaluation shows its error over frequency and every predictor", async () => {
  await page.goto(`${product.url}/evaluations/${member("evaluate")}`);
  await assertFigureIsDrawn();
  const text = await page.locator("body").innerText();
  for (const predictor of ["hold-last", "damped-integrator", "least-squares", "robomorph"]) {
    assert.ok(text.includes(predictor), `${predictor} is not on the page`);
  }
  // Its grid extends beyond the single frequency of the training.
  assert.match(text, /u of joint \d reaches -?[\d.]+ N·m; the checkpoint was trained on/);
  assert.match(text, /From sample to sample/);
  // The result comes first: a sentence, then a table of everyone's errors with the models on top.
  assert.match(await page.locator(".answer").innerText(), /^lagrangian predicts the horizon in distribution with an error of/);
  const table = page.locator("table.result").first();
  assert.match(await table.locator("tbody tr").first().innerText(), /^lagrangian/);
  const below = async (locator) => (await locator.boundingBox()).y;
  assert.ok(await below(table) < await below(page.locator("figure").first()));
  assertClean();
});

test("a figure answers: values, a part drawn larger, a curve switched off, a PNG", async () => {
  await page.goto(`${product.url}/evaluations/${member("evaluate")}`);
  const figure = page.locator("figure", { has: page.locator("img[src$='/prediction-median.svg']") });
  const image = figure.locator("img");
  const table = await (await fetch((await image.evaluate((it) => it.src)).replace(".svg", ".csv"))).text();
  await image.scrollIntoViewIfNeeded();
  const { height } = await figure.boundingBox();
  await image.hover();
  const chart = figure.locator(".chart > svg");
  await chart.waitFor();
  assert.equal((await figure.boundingBox()).height, height, "nothing moves");
  assert.equal(await image.isVisible(), false);

  // The reading has the numbers of the table.
  const box = await chart.boundingBox();
  const at = (across, down) => page.mouse.move(box.x + box.width * across, box.y + box.height * down);
  // In the first half only the truth is drawn.
  await at(0.8, 0.5);
  const reading = figure.locator(".reading");
  const time = Number((await reading.locator("strong").innerText()).match(/: ([-\d.e]+) s/)[1]);
  const rows = table.trim().split("\n").slice(1).map((line) => line.split(","));
  const near = (name) => rows.find(([series, x]) => series === name && Math.abs(x - time) < 1e-4);
  const said = await reading.locator("div").evaluateAll((them) =>
    them.map((it) => [it.querySelector("span").textContent, Number.parseFloat(it.querySelector("b").textContent)]));
  assert.ok(said.length > 2 && said[0][0] === "truth", JSON.stringify(said));
  for (const [name, value] of said) {
    assert.ok(Math.abs(near(name)[2] - value) <= 1e-4 * Math.abs(value) + 1e-9, `${name}: ${value}, ${near(name)}`);
  }

  // A curve is switched off by its name, and by the keyboard.
  const key = figure.locator(".key").nth(1);
  await key.click();
  assert.equal(await key.getAttribute("aria-checked"), "false");
  await at(0.8, 0.5);
  assert.equal(await reading.locator("div").count(), said.length - 1);
  await key.focus();
  await page.keyboard.press("Enter");
  assert.equal(await key.getAttribute("aria-checked"), "true");

  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => globalThis.axe.run("figure[data-chart]"));
  assert.deepEqual(violations.filter(({ impact }) => ["serious", "critical"].includes(impact)), []);

  // The keyboard reads, too.
  await figure.locator(".scroll").focus();
  await page.keyboard.press("ArrowLeft");
  assert.equal(await reading.isVisible(), true);

  await at(0.4, 0.5);
  await page.mouse.down();
  await at(0.5, 0.5);
  await page.mouse.up();
  assert.equal(await figure.locator(".zoomed").count(), 1);
  assert.ok(await figure.locator(".zoomed text").count() > 5, "the axes are drawn again");
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    figure.getByRole("button", { name: "PNG" }).click(),
  ]);
  const png = await readFile(await download.path());
  assert.deepEqual([...png.subarray(0, 4)], [0x89, 0x50, 0x4e, 0x47]);
  assert.equal(download.suggestedFilename(), "prediction-median.png");
  assert.deepEqual([png.readUInt32BE(16), png.readUInt32BE(20)], [1520, 840]);
  await figure.getByRole("button", { name: "Whole range" }).click();
  assert.equal(await figure.locator(".zoomed").count(), 0);
  assertClean();
});

test("a finger reads a value as a pointer does, with the first tap", async () => {
  const context = await browser.newContext({ hasTouch: true, viewport: { width: 390, height: 844 } });
  const phone = await context.newPage();
  const { run } = await product.get(`/v1/jobs/${member("train")}`);
  await phone.goto(`${product.url}/runs/${run}`);
  await phone.locator("figure").first().scrollIntoViewIfNeeded();
  const drawing = phone.locator("figure .chart > svg").first();
  await drawing.waitFor();
  const box = await drawing.boundingBox();
  await phone.touchscreen.tap(box.x + 200, box.y + 100);
  const reading = phone.locator(".reading");
  await reading.waitFor();
  assert.match(await reading.innerText(), /optimizer step: \d+/);
  await context.close();
});

test("a drawn prediction leads to all its joints, where another checkpoint stands beside it", async () => {
  await page.goto(`${product.url}/evaluations/${member("evaluate")}`);
  const drawn = await page.locator("figcaption").first().innerText();
  await page.getByRole("link", { name: "all joints" }).first().click();
  await page.waitForURL(/predict\?dataset=/);
  const [, index] = drawn.match(/trajectory ([\d\u2009]+)/);
  assert.match(await page.locator("h1").innerText(), new RegExp(`trajectory ${index.replaceAll("\u2009", "")} of`));
  // Both models and hold-last.
  assert.equal(await page.locator("table.result tbody tr").count(), 3);
  const training = await product.get(`/v1/jobs/${member("train")}`);
  await page.goto(`${product.url}/checkpoints/${Math.max(...training.checkpoints)}`);
  await page.getByRole("link", { name: "Look at predictions" }).click();
  await page.waitForURL(/predict\?checkpoint=/);
  assert.match(await page.locator("h1").innerText(), /Predictions of trajectory 0 of dataset/);
  const first = await page.locator("table.result tbody tr").first().innerText();
  assert.match(first, /^robomorph|^lagrangian|^cdt/);
  assert.match(await page.locator("table.result").innerText(), /hold-last/);
  await page.getByLabel("Trajectory", { exact: true }).fill("17");
  await page.getByRole("button", { name: "Predict" }).click();
  await page.waitForURL(/trajectory=17/);
  assert.match(await page.locator("figure svg title").first().textContent(), /trajectory 17/);
  // A drawing that has no address is saved from the page.
  const figure = page.locator("figure").first();
  await figure.hover();
  await figure.locator(".chart > svg").waitFor();
  const saved = async (name) => {
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      figure.getByRole("button", { name }).click(),
    ]);
    return { file: download.suggestedFilename(), text: await readFile(await download.path(), "utf8") };
  };
  const table = await saved("CSV");
  assert.match(table.file, /\.csv$/);
  assert.match(table.text, /^figure,series,Time since the end of the context \(s\),y,low,high,quantity of y\n/);
  assert.match(table.text, /\nJoint 1,truth,[-\d.e]+,[-\d.e]+,,,position \(°\)\n/);
  const drawing = await saved("SVG");
  assert.match(drawing.file, /\.svg$/);
  assert.match(drawing.text, /^<svg .*trajectory 17/s);
  await page.getByRole("link", { name: "Next" }).click();
  await page.waitForURL(/trajectory=18/);
  await page.getByLabel("Horizon begins at sample").fill("5");
  await page.getByRole("button", { name: "Predict" }).click();
  assert.match(await page.getByRole("alert").innerText(), /begin is 5, allowed: /);
  assert.equal(await page.getByLabel("Horizon begins at sample").inputValue(), "5");
  assertClean();
});

test("the lineage leads from a dataset over its training to the evaluation, and back", async () => {
  const train = await (await fetch(`${product.url}/v1/jobs/${member("train-set")}`)).json();
  await page.goto(`${product.url}/datasets/${train.dataset}`);
  const lineage = page.locator(".lineage");
  const of = (name) => lineage.locator("a").filter({ has: page.locator("text", { hasText: new RegExp(`^${name}`) }) });
  await of("train, ").first().click();
  await page.waitForURL(/\/runs\/\d+$/);
  assert.equal(await lineage.locator("[aria-current]").count(), 1);
  await of("evaluate, ").click();
  await page.waitForURL(/\/evaluations\/\d+$/);
  // The evaluation has its own dataset, too.
  assert.equal(await of("simulate, ").count(), 2);
  assertClean();
});

test("all runs are filtered and sorted by a metric and a parameter", async () => {
  await page.goto(`${product.url}/logged`);
  const names = () => page.locator("td.name").allInnerTexts();
  assert.ok((await names()).length >= 3);
  const filter = page.getByLabel("Filter in MLflow's syntax");
  await filter.fill("params.`model.architecture` = 'robomorph' and metrics.`train/loss` < 1e9");
  await filter.press("Enter");
  await page.waitForURL(/filter=/);
  assert.deepEqual(await names(), ["train"]);
  await page.goto(`${product.url}/logged?columns=model.architecture,train/loss`);
  await page.getByRole("link", { name: "train/loss" }).click();
  await page.waitForURL(/order=/);
  const losses = await page.locator("td[data-label='train/loss']").allInnerTexts();
  const numbers = losses.map((text) => Number(text.replace("\u2212", "-")));
  assert.ok(numbers.length >= 2 && numbers.every((it, k) => k === 0 || it >= numbers[k - 1]), losses.join());
  await page.goto(`${product.url}/logged?filter=loss`).catch(() => {});
  assert.match(await page.getByRole("alert").innerText(), /allowed: metrics.KEY/);
  complaints = complaints.filter((it) => !/400/.test(it));
  assertClean();
});

test("runs that are ticked in their list stand beside each other", async () => {
  await page.goto(`${product.url}/runs`);
  for (const box of await page.getByRole("checkbox").all()) await box.check();
  await page.getByRole("button", { name: "Compare" }).click();
  await assertFigureIsDrawn();
  // A change is answered at once, and the address follows.
  await page.locator("select[name=metric]").selectOption("train/loss");
  await page.locator("select[name=x]").selectOption("time");
  await page.waitForURL(/metric=train%2Floss&x=time/);
  await page.locator("figure svg text", { hasText: "time (s)" }).first().waitFor();
  const slider = page.getByRole("slider", { name: "Smoothing" });
  await slider.fill("0.5");
  await page.waitForURL(/smoothing=0\.5/);
  await page.getByRole("button", { name: "Show" }).click();
  assert.match(await page.locator("body").innerText(), /Parameters that differ/);
  assertClean();
});

test("ticked runs are kept over orders and lists, counted in a bar at the window's edge, and compared by a key", async () => {
  await page.setViewportSize({ width: 1200, height: 420 });
  await page.goto(`${product.url}/runs`);
  const [first, second] = await page.locator(".tick input").evaluateAll((all) => all.map((it) => it.value));
  const box = (run) => page.locator(`.tick input[value="${run}"]`);
  await box(first).check();
  await box(second).check();
  const bar = page.getByRole("button", { name: "Compare (2)" });
  const { y, height } = await bar.boundingBox();
  assert.ok(y + height <= 420, `the bar ends at ${y + height}`);
  await page.getByRole("link", { name: "name", exact: true }).click();
  await page.waitForURL(/sort=/);
  await bar.waitFor();
  assert.ok(await box(first).isChecked() && await box(second).isChecked());
  await page.goto(`${product.url}/logged`);
  await bar.waitFor();
  assert.ok(await box(first).isChecked());
  await box(second).uncheck();
  await page.getByRole("button", { name: "Compare (1)" }).waitFor();
  await box(second).check();
  // Those that a filter hides are compared, too.
  await page.goto(`${product.url}/runs?text=no-run-has-this-name`);
  await page.goto(`${product.url}/runs?sort=name`);
  await page.keyboard.press("c");
  await page.waitForURL(/compare/);
  assert.deepEqual(new URL(page.url()).searchParams.getAll("run").sort(), [first, second].sort());
  await page.goto(`${product.url}/runs`);
  await page.getByRole("button", { name: "Clear" }).click();
  assert.equal(await page.locator(".tick input:checked").count(), 0);
  await page.getByRole("button", { name: "Compare", exact: true }).waitFor();
  assertClean();
});

test("a job is duplicated, refused beside the field that is wrong, corrected and launched", async () => {
  await page.goto(`${product.url}/jobs/${member("train-set")}`);
  await page.getByRole("link", { name: "Duplicate and edit" }).click();
  const form = page.getByRole("form", { name: "Fields of the spec" });
  const trajectories = form.locator('[name="set:trajectories"]');
  assert.equal(await trajectories.getAttribute("placeholder"), "2048");
  await trajectories.fill("-3");
  await form.getByLabel("Name").fill("fewer");
  complaints.length = 0;
  await form.getByRole("button", { name: "Launch" }).click();
  await page.getByRole("alert").waitFor();
  assert.equal(await trajectories.inputValue(), "-3");
  assert.match(await form.locator("label", { has: page.locator('[name="set:trajectories"]') }).innerText(), /allowed: 1 to/);
  // The status of the page is a refusal, of which the browser's console tells.
  complaints.length = 0;
  await trajectories.fill("64");
  await form.locator("summary", { hasText: "observations" }).click();
  await form.locator('[name="set:observations.joint_velocities"]').selectOption("true");
  await form.getByRole("button", { name: "Show as JSON" }).click();
  const json = page.getByLabel("Spec, as JSON");
  assert.equal(await json.isVisible(), true);
  const text = await json.inputValue();
  assert.deepEqual([JSON.parse(text).trajectories, JSON.parse(text).observations.joint_velocities], [64, true]);
  await form.getByRole("button", { name: "Launch" }).click();
  await page.waitForURL(/\/jobs\/\d+$/);
  assert.match(await page.locator("h1").innerText(), /fewer/);
  assertClean();
});

test("an arm and its logs are uploaded, refused with what is wrong, and become a robot and a dataset", async () => {
  const link = (name) => `<link name="${name}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>`;
  const urdf = `<robot name="bench arm"><link name="base"/>${link("upper")}<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="4"/></joint></robot>`;
  await page.goto(`${product.url}/robots`);
  await page.getByRole("link", { name: "Upload a URDF" }).click();
  const arm = page.locator("form", { has: page.getByRole("button", { name: "Add the arm" }) });
  await arm.locator("[type=file]").setInputFiles({ name: "bench.urdf", mimeType: "", buffer: Buffer.from(urdf) });
  await arm.getByRole("button", { name: "Add the arm" }).click();
  await page.waitForURL(/\/robots\/\d+$/);
  assert.match(await page.locator("h1").innerText(), /bench arm/);

  const log = (phase) => ["t,u1,q1", ...Array.from({ length: 120 }, (_, k) => `${k / 60},${Math.sin(k / 20 + phase)},${0.5 * Math.cos(k / 30 + phase)}`)].join("\n") + "\n";
  const files = ["monday", "tuesday"].map((name, phase) => ({ name: `${name}.csv`, mimeType: "text/csv", buffer: Buffer.from(log(phase)) }));
  await page.goto(`${product.url}/upload`);
  const recordings = page.locator("form", { has: page.getByRole("button", { name: "Import" }) });
  const send = async (mapping) => {
    await recordings.locator("textarea").fill(JSON.stringify(mapping));
    await recordings.locator("select[name=robot]").selectOption({ label: (await recordings.locator("option", { hasText: "bench arm" }).innerText()).trim() });
    await recordings.locator("[type=file]").setInputFiles(files);
    await recordings.getByRole("button", { name: "Import" }).click();
  };
  const mapping = { columns: { time: "t", u: ["u1"], q: ["q1"] }, samples: 40, split: { kind: "windows", stride: 40 } };
  await send({ ...mapping, samples: 1 });
  await page.getByRole("alert").waitFor();
  assert.match(await page.getByRole("alert").innerText(), /samples is 1; allowed: 2 to/);
  assert.match(await recordings.locator("textarea").inputValue(), /"samples":1/);
  // The status of the page is a refusal, of which the browser's console tells.
  complaints.length = 0;
  await send(mapping);
  await page.waitForURL(/\/jobs\/\d+$/);
  await page.locator(".badge.succeeded").first().waitFor({ timeout: 30_000 });
  const job = await product.get(new URL(page.url()).pathname.replace("/jobs", "/v1/jobs"));
  assert.deepEqual(job.spec.files.map((file) => file.name), ["monday", "tuesday"]);
  assert.equal((await product.get(`/v1/datasets/${job.dataset}`)).trajectories, 6);
  assertClean();
});

test("the keyboard searches, walks through a list, ticks, and goes to other pages", async () => {
  await page.goto(`${product.url}/runs`);
  const focused = (what) => page.evaluate((what) => document.activeElement[what], what);
  await page.keyboard.press("/");
  assert.equal(await focused("name"), "text");
  await page.keyboard.type("j?");
  assert.equal(await focused("value"), "j?");
  await page.evaluate(() => document.activeElement.blur());
  const links = page.locator("td.name > a");
  const [first, second] = await links.evaluateAll((all) => all.map((it) => it.href));
  await page.keyboard.press("j");
  await page.keyboard.press("j");
  assert.equal(await focused("href"), second);
  await page.keyboard.press("x");
  await page.keyboard.press("k");
  assert.equal(await focused("href"), first);
  assert.deepEqual(await page.locator("td.tick input").evaluateAll((all) => all.slice(0, 2).map((it) => it.checked)), [false, true]);
  await page.keyboard.press("Enter");
  await page.waitForURL(first);
  await page.keyboard.press("g");
  await page.keyboard.press("d");
  await page.waitForURL("**/datasets");
  await page.keyboard.press("?");
  const keys = page.getByRole("dialog", { name: "Shortcuts" });
  assert.match(await keys.innerText(), /g\s*d\s*Datasets/);
  await keys.getByRole("checkbox").uncheck();
  await keys.getByRole("button", { name: "Close" }).click();
  await page.keyboard.press("?");
  assert.equal(await keys.count(), 0);
  await page.getByRole("button", { name: "Shortcuts" }).click();
  await keys.getByRole("checkbox").check();
  await page.keyboard.press("Escape");
  await page.keyboard.press("g");
  await page.keyboard.press("l");
  await page.waitForURL("**/launch");
  // A page that is left at once stops loading its icon.
  complaints = complaints.filter((it) => !it.endsWith("icon.svg failed"));
  assertClean();
});

test("a sweep launches a job for each value", async () => {
  const training = await product.get(`/v1/jobs/${member("train")}`);
  await page.goto(`${product.url}/launch?job=${training.id}`);
  const form = page.getByRole("form", { name: "Fields of the spec" });
  await form.getByLabel("Sweep over the field").fill("optimizer.learning_rate");
  await form.getByLabel("with the values").fill("1e-3, 1e-4");
  await form.getByRole("button", { name: "Launch" }).click();
  await page.waitForURL(/\/jobs\/\d+$/);
  const sweep = await product.get(new URL(page.url()).pathname.replace("/jobs", "/v1/jobs"));
  assert.deepEqual(sweep.members.map((it) => it.name), [
    "train-1-learning-rate-0-001",
    "train-2-learning-rate-0-0001",
  ]);
  await fetch(`${product.url}/v1/jobs/${sweep.id}/cancel`, { method: "POST" });
  assertClean();
});

test("the checkpoint downloads with the digest that the API states", async () => {
  const { checkpoints } = await product.get(`/v1/jobs/${member("train")}`);
  const id = Math.max(...checkpoints);
  const { files } = await product.get(`/v1/checkpoints/${id}`);
  const weights = files.find((file) => file.name.endsWith(".safetensors"));
  await page.goto(`${product.url}/checkpoints/${id}`);
  await page.getByText(/^Files \(/).click();
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.locator(`a[href$="${weights.url}"]`).first().click(),
  ]);
  const bytes = await readFile(await download.path());
  assert.equal(createHash("sha256").update(bytes).digest("hex"), weights.sha256);
  assert.deepEqual(strangers, []);
});

test("a dataset shows its arms, its channels, its spectra and one trajectory after the other", async () => {
  const { dataset } = await product.get(`/v1/jobs/${member("train-set")}`);
  await page.goto(`${product.url}/datasets/${dataset}`);
  assert.match(await page.locator("body").innerText(), /link mass, kg/i);
  await page.getByText("Channels", { exact: true }).click();
  assert.match(await page.locator("body").innerText(), /position of joint 7/);
  await page.getByText("Mean spectra of each joint").click();
  await assertLoaded("img[src$='/spectrum.svg']");
  await assertLoaded("img[src$='/trajectories/0/figure.svg']");
  await page.getByRole("link", { name: "Next" }).click();
  await assertLoaded("img[src$='/trajectories/1/figure.svg']");
  await page.getByLabel("Index").fill("2047");
  await page.getByRole("button", { name: "Show" }).click();
  await assertLoaded("img[src$='/trajectories/2047/figure.svg']");
  assert.equal(await page.getByRole("link", { name: "Next" }).count(), 0);
  assertClean();
});

test("a dataset is verified by a button, and the page tells when it was", async () => {
  const { dataset } = await product.get(`/v1/jobs/${member("train-set")}`);
  await page.goto(`${product.url}/datasets/${dataset}`);
  await page.getByRole("button", { name: "Verify" }).click();
  const outcome = page.getByText(/Verified: all 2 shards agree in every byte/);
  await outcome.waitFor({ timeout: 30_000 });
  assertClean();
});

test("the page shows what happens without asking for it", async () => {
  let fetched = 0;
  page.on("request", (request) => {
    if (request.url() === `${product.url}/`) fetched += 1;
  });
  const opened = page.waitForResponse(`${product.url}/v1/events`);
  await page.goto(product.url);
  assert.equal((await opened).headers()["content-type"], "text/event-stream");
  await page.waitForTimeout(4000);
  const before = fetched;
  await page.waitForTimeout(4000);
  assert.equal(fetched, before, "while nothing happens nothing is fetched");

  const submitted = await fetch(`${product.url}/v1/jobs`, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ preset: "D1-multisine", trajectories: 10, seed: 77 }),
  });
  const { id } = await submitted.json();
  // Without events it would appear after half a minute.
  await page.locator(`a[href$="/jobs/${id}"]`).first().waitFor({ timeout: 8000 });
  await page.locator("article", { has: page.locator(`a[href$="/jobs/${id}"]`) })
    .getByText("succeeded").waitFor({ timeout: 20_000 });
  assertClean();
});

test("a list renews itself, and keeps what is ticked", async () => {
  await page.goto(`${product.url}/runs`);
  const box = page.getByRole("checkbox").last();
  await box.check();
  const submitted = await fetch(`${product.url}/v1/jobs?name=a%20short%20one`, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ ...(await specOf("train")), steps: 3 }),
  });
  const { id } = await submitted.json();
  const row = page.locator("tr", { hasText: "a short one" });
  await row.getByText("succeeded").waitFor({ timeout: 30_000 });
  assert.match(await row.innerText(), new RegExp(`\\b${id}\\b`));
  assert.ok(await page.getByRole("checkbox").last().isChecked());
  assertClean();
});

test("moments are in the reader's time zone, and their titles in UTC", async () => {
  const context = await browser.newContext({ timezoneId: "Asia/Kolkata" });
  const there = await context.newPage();
  await there.goto(product.url);
  const shown = there.locator("time").first();
  await there.waitForFunction(() => document.querySelector("time[title]"));
  const [text, title] = [await shown.innerText(), await shown.getAttribute("title")];
  assert.match(title, /^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC$/);
  assert.match(text, / \+05:30$/);
  const local = new Date(text.replace(" +", "+").replace(" ", "T"));
  assert.equal(local.getTime(), new Date(title.replace(" UTC", "Z").replace(" ", "T")).getTime());
  await context.close();
});

test("a note is Markdown, and a spec leads to what it names", async () => {
  const { run } = await product.get(`/v1/jobs/${member("train")}`);
  await page.goto(`${product.url}/runs/${run}`);
  await page.getByText("Change name, tags and note").click();
  await page.getByLabel("Note").fill("## Why\n\n*Less* damping, <b>bold</b>\n- [data](/datasets)");
  await page.getByRole("button", { name: "Save" }).click();
  const note = page.locator("div.said");
  assert.equal(await note.locator("em").innerText(), "Less");
  assert.equal(await note.locator("b").count(), 0);
  assert.match(await note.innerText(), /<b>bold<\/b>/);
  await page.getByText("Specification").click();
  const source = page.locator("#specification a");
  assert.equal(await source.getAttribute("data-name"), "train-set");
  await source.click();
  await page.waitForURL(/\/datasets\/\d+$/);
  assertClean();
});

test("a page whose stream is refused is fetched now and then", async () => {
  const submitted = await fetch(`${product.url}/v1/jobs`, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({
      preset: "D1-multisine", trajectories: 10, seed: 78,
      execution: { not_before: new Date(Date.now() + 3_600_000).toISOString() },
    }),
  });
  const { id } = await submitted.json();
  await page.route(`${product.url}/v1/jobs/${id}/events`, (route) => route.fulfill({ status: 503 }));
  await page.goto(`${product.url}/jobs/${id}`);
  for (let fetched = 0; fetched < 3; fetched += 1) {
    await page.waitForRequest(`${product.url}/jobs/${id}`, { timeout: 20_000 });
  }
  await fetch(`${product.url}/v1/jobs/${id}/cancel`, { method: "POST" });
  await page.locator("#job").getByText("cancelled").first().waitFor({ timeout: 20_000 });
});

test("the page works without scripts", async () => {
  const context = await browser.newContext({ javaScriptEnabled: false });
  const plain = await context.newPage();
  await plain.goto(product.url);
  await plain.locator(`a[href$="/jobs/${product.pipeline.id}"]`).first().click();
  assert.match(await plain.locator("body").innerText(), /train-set/);
  await context.close();
});

/** The spec of a member of the pipeline. */
async function specOf(name) {
  const { spec } = await product.get(`/v1/jobs/${member(name)}`);
  return spec;
}

/** Asserts that the image at `selector` loads and is not tiny. */
async function assertLoaded(selector) {
  const image = page.locator(selector);
  await image.waitFor();
  await image.evaluate((it) => it.decode());
  const box = await image.boundingBox();
  assert.ok(box.width > 200 && box.height > 100, JSON.stringify(box));
}

/** Asserts that a figure, an image or inline SVG, has a size on the screen. */
async function assertFigureIsDrawn() {
  const figure = page.locator("img[src*='.svg'], figure svg, object[data*='.svg']").first();
  await figure.waitFor();
  const box = await figure.boundingBox();
  assert.ok(box.width > 200 && box.height > 100, JSON.stringify(box));
  const loaded = await figure.evaluate((it) => it.tagName !== "IMG" || it.naturalWidth > 0);
  assert.ok(loaded, "the image did not load");
}
