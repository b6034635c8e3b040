import { describe, expect, it } from "vitest";
import { fillText } from "../samples/texts";
import type { ChartLayout } from "../wire/types";
import {
  BUILT_IN_LAYOUTS,
  MOST,
  moved,
  neighbour,
  PANELS,
  panelOf,
  panelsOf,
  readIn,
  renamed,
  resized,
  STANDARD,
  titleFor,
  withOver,
  withoutPanel,
  withoutSignal,
  withPanel,
  withSignal,
  withTitle,
} from "./layouts";
import { DRAWN, scaleOf, signalOf, traceFor, unitOf } from "./signals";
import { TEXTS } from "./texts";

const MINE: ChartLayout = {
  version: 1,
  name: "Mine",
  panels: [
    { title: "A", signals: ["q", "q_ref"], over: null, share: 1 },
    { title: "Plane", signals: ["S"], over: "q", share: 1 },
    { title: "B", signals: ["F_A"], over: null, share: 4 },
  ],
};
const done = (edited: ChartLayout | string) => {
  if (typeof edited === "string") throw new Error(edited);
  return edited;
};

describe("built-in layouts", () => {
  it.each(BUILT_IN_LAYOUTS.map((layout) => [layout.name, layout] as const))(
    "%s satisfies the rules of the service",
    (_, layout) => {
      expect(layout.panels.length).toBeLessThanOrEqual(MOST.panels);
      expect(new Set(layout.panels.map(({ title }) => title)).size).toBe(layout.panels.length);
      expect(layout.panels.some(({ over }) => over === null)).toBe(true);
      for (const { signals, over } of layout.panels) {
        expect(new Set(signals.map(unitOf)).size).toBe(1);
        for (const name of [...signals, ...(over === null ? [] : [over])])
          expect(DRAWN.map((one) => one.name)).toContain(name);
      }
      expect(panelsOf(layout)).toHaveLength(layout.panels.length);
    },
  );

  it("contains the standard charts", () => {
    expect(PANELS.map(({ title, unit, decimals }) => [title, unit, decimals])).toEqual([
      ["Joint position", "rad", 4],
      ["Joint stiffness", "N·m/rad", 3],
      ["Tendon force", "N", 2],
      ["Motor voltage", "V", 2],
      [TEXTS.externalForce, "N", 2],
    ]);
    const forces = PANELS[2]?.traces.map(({ name, hue, broad }) => [name, hue, broad]);
    expect(forces).toEqual([
      ["F_A", "#009E73", true],
      ["F_B", "#CC79A7", undefined],
    ]);
    expect(PANELS[4]?.traces.map(({ dashed }) => dashed)).toEqual([true, false]);
    const stiffness = PANELS[1]?.traces.map(({ name, dashed, broad }) => [name, dashed, broad]);
    expect(stiffness, "a reference is visible next to the signal that covers it").toEqual([
      ["S_ref", true, true],
      ["S", false, undefined],
    ]);
  });
});

it("can draw every signal in a panel of its own", () => {
  for (const { name, unit } of DRAWN) {
    const panel = panelOf({ title: name, signals: [name], over: null, share: 1 });
    expect(panel?.traces[0]?.hue).toMatch(/^#[0-9A-F]{6}$/);
    expect(panel?.factor).toBe(unit === "m" || name === "lateness_s" ? 1000 : 1);
  }
  expect(scaleOf(["q - q_ref"]).narrowest).toBeLessThan(scaleOf(["q"]).narrowest);
  expect(scaleOf(["lam_q", "lateness_s"]).unit).toBe("s");
});

it("converts an error and its horizontal axis to degrees", () => {
  const panel = panelOf({ title: "e", signals: ["q - q_ref"], over: "q", share: 1 });
  const read = readIn(panel as NonNullable<typeof panel>, "deg");
  expect([read.unit, read.decimals, read.over?.unit, read.over?.decimals]).toEqual(["°", 3, "°", 2]);
  expect(read.factor).toBeCloseTo(180 / Math.PI, 12);
});

it("gives an error the colour of its signal, and two errors different lines", () => {
  expect(signalOf("S - S_ref_gov")).toBe("S");
  const both = ["q - q_ref", "q - q_ref_gov"];
  expect(both.map((name) => traceFor(name, both)).map(({ hue, dashed }) => [hue, dashed])).toEqual([
    ["#0072B2", false],
    ["#0072B2", true],
  ]);
});

it("omits unknown signals, such as those stored by a later version", () => {
  const strange = { title: "x", signals: ["q_new", "q"], over: null, share: 1 };
  expect(panelOf(strange)?.traces.map(({ name }) => name)).toEqual(["q"]);
  expect(panelOf({ ...strange, over: "q_new" })).toBeNull();
});

describe("editing", () => {
  it("refuses a second unit in one panel, and states both units", () => {
    expect(withSignal(MINE, 0, "S")).toBe(
      fillText(TEXTS.oneUnit, { signal: "S", unit: "N·m/rad", title: "A", shown: "rad" }),
    );
    expect(done(withSignal(MINE, 0, "theta_A")).panels[0]?.signals).toEqual(["q", "q_ref", "theta_A"]);
    expect(withSignal(MINE, 0, "q")).toBe(fillText(TEXTS.signalShown, { title: "A", signal: "q" }));
  });

  it("requires one panel over time, and one signal in each panel", () => {
    const two = done(withoutPanel(MINE, 0));
    expect(withoutPanel(two, 1)).toBe(TEXTS.timeNeeded);
    expect(withOver(two, 1, "x_A")).toBe(TEXTS.timeNeeded);
    expect(withoutSignal(MINE, 2, "F_A")).toBe(fillText(TEXTS.lastSignal, { signal: "F_A", title: "B" }));
    expect(done(withoutSignal(MINE, 0, "q_ref")).panels[0]?.signals).toEqual(["q"]);
  });

  it("swaps a panel with the next one of its kind", () => {
    expect(moved(MINE, 0, 1).panels.map(({ title }) => title)).toEqual(["B", "Plane", "A"]);
    expect([neighbour(MINE, 0, -1), neighbour(MINE, 1, 1), neighbour(MINE, 2, -1)]).toEqual([null, null, 0]);
    expect(moved(MINE, 1, 1)).toBe(MINE);
  });

  it("limits heights to their bounds", () => {
    expect(done(resized(MINE, 2, 1)).panels[2]?.share).toBe(4);
    expect(done(resized(MINE, 0, -3)).panels[0]?.share).toBe(0.5);
    expect(done(resized(MINE, 0, 1)).panels[0]?.share).toBe(1.5);
  });

  it("gives a new panel an unused title", () => {
    const once = done(withPanel(STANDARD, "q"));
    const { title } = once.panels.at(-1) as { title: string };
    const twice = done(withPanel(once, "q"));
    expect(STANDARD.panels.map((panel) => panel.title)).not.toContain(title);
    expect(twice.panels.at(-1)).toEqual({ title: `${title} 2`, signals: ["q"], over: null, share: 1 });
    expect(titleFor("lateness_s", [])).toBe("lateness_s");
    const full = { ...MINE, panels: Array.from({ length: MOST.panels }, () => MINE.panels[0] as never) };
    expect(withPanel(full, "q")).toBe(fillText(TEXTS.panelsFull, { count: 12 }));
  });

  it("refuses titles and names that are empty or taken", () => {
    expect(withTitle(MINE, 0, " B ")).toBe(fillText(TEXTS.titleTaken, { title: "B" }));
    expect(withTitle(MINE, 0, " ")).toBe(TEXTS.titleMissing);
    expect(renamed(MINE, "")).toBe(TEXTS.nameMissing);
    expect(done(renamed(MINE, " Ours ")).name).toBe("Ours");
  });
});
