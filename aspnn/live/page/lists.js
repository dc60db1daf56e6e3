// Figures and lists: the numerals, alarms, targets, and how right ours and the arc have been.

import { ahead, byId, direction, distance, element, knots, known, number, refill, sided, touches, utc, write } from "./format.js";

const ALARMS = 5; // shown at once, the gravest
const TARGETS = 5;

export function drawNumerals({ own, time, model, arc, simulated }) {
  write("ship", own?.name ?? "No position");
  write("simulated", simulated ? `SIMULATED ${simulated.scenario ?? ""}` : "");
  write("clock", utc(time));
  write("hdg", direction(own?.heading));
  write("cog", direction(own?.cog));
  write("sog", knots(own?.sog));
  write("stw", knots(own?.stw));
  write("rot", sided(own?.rot, Math.abs(own?.rot ?? 0) < 10 ? 1 : 0));
  const fits = model?.fits === false ? "does not fit this ship today" : model?.outside ? "outside its training" : "";
  byId("model").classList.toggle("doubt", fits !== "" || (!model && arc !== null));
  write("model", model ? `Predictor ${model.name}${fits ? `: ${fits}` : ""}` : arc ? "No predictor: predicted vector only" : "");
}

export function drawAlarms({ alarms, time }) {
  const rows = (alarms ?? []).slice(0, ALARMS).map((alarm) => {
    const kind = ["alarm", "warning", "caution"].includes(alarm.severity) ? alarm.severity : "warning";
    return [kind, alarm.text, known(alarm.since) && known(time) ? ahead(Math.max(0, time - alarm.since)) : ""];
  });
  refill(byId("alarms"), rows, () => rows.map(([kind, text, since]) => element("div", { class: kind }, text, element("span", { class: "since" }, since))));
}

const cells = (texts) => texts.map((text) => element("td", {}, ...[text].flat()));
const minor = (text) => element("span", { class: "minor" }, text);
const head = (...names) => element("tr", {}, ...names.map((name) => element("th", {}, name)));

// What came in and what was refused, for whoever looks for a fault.
export function drawCounts({ counts }) {
  if (!counts || byId("layers").hidden) return;
  const refused = Object.entries(counts.rejected).filter(([, count]) => count > 0);
  const rows = [["sentences", counts.sentences], ...refused.map(([name, count]) => [`rejected: ${name}`, count]), ["late", counts.late]];
  refill(byId("counts"), rows, () => rows.map((row) => element("tr", {}, ...cells(row))));
}

// What is nearest at the end of the prediction may come nearer still.
const within = (time, horizon) => (known(time) && time >= horizon - 0.5 ? `≥ ${ahead(horizon)}` : ahead(time));
const share = (chance) => (known(chance) ? (chance < 0.01 ? "<1 %" : `${Math.round(100 * chance)} %`) : "–");

// Rows of [dangerous, name, CPA, TCPA, chance of contact, DCPA and TCPA on straight lines].
export function drawTargets({ targets, forecast, horizon }) {
  const near = forecast?.clearance;
  const rows = near ? [[touches(near), near.what === "danger" ? "charted danger" : (near.what ?? "shore"), distance(near.distance), within(near.time, horizon), "", ""]] : [];
  for (const target of (targets ?? []).slice(0, TARGETS)) {
    const classical = known(target.dcpa) && target.dtcpa >= 0 ? `${distance(target.dcpa)} ${ahead(target.dtcpa)}` : "past";
    rows.push([target.dangerous, target.name ?? target.id, distance(target.cpa), within(target.tcpa, horizon), share(target.probability), classical]);
  }
  const more = (targets?.length ?? 0) - TARGETS;
  if (more > 0) rows.push([false, `and ${more} more`, "", "", "", ""]);
  if (!targets?.length) rows.push([false, "no targets", "", "", "", ""]);
  refill(byId("targets"), rows, () => [
    head("", "CPA", "TCPA", "contact", "straight lines"),
    ...rows.map(([dangerous, ...texts]) => element("tr", { class: dangerous ? "dangerous" : "" }, ...cells([...texts.slice(0, 4), minor(texts[4])]))),
  ]);
}

// Which one was right: errors of the predictions that have come to their end, the smaller of the two in bold.
export function drawScores({ scores }) {
  if (!scores) return;
  const { horizons, count, ours, arc } = scores;
  const metres = (value) => number(value, value < 9.95 ? 1 : 0);
  const row = (of, other) => of.median.map((v, k) => [known(v) && (!known(other.median[k]) || v <= other.median[k]), known(v) ? metres(v) : "–", known(of.last[k]) ? metres(of.last[k]) : ""]);
  const apart = Math.max(0, ...(scores.set_apart ?? []));
  const said = `${Math.max(0, ...count)} judged${apart ? `, ${apart} set apart` : ""}`;
  const rows = [["ours", "Predicted path", row(ours, arc)], ["arc", "Predicted vector", row(arc, ours)]];
  refill(byId("scores"), [rows, said, horizons], () => [
    head("Error, m: median (last)", ...horizons.map((time) => `after ${ahead(time)}`)),
    ...rows.map(([kind, name, values]) =>
      element("tr", {}, element("td", { class: kind }, name), ...values.map(([better, median, last]) => element("td", { class: better ? "better" : "" }, median, " ", minor(last && `(${last})`)))),
    ),
  ]);
  write("judged", said);
}
