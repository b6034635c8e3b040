import { MantineProvider } from "@mantine/core";
import { cleanup, fireEvent, render, screen, within } from "@testing-library/react";
import { type ReactElement, useState } from "react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { SAMPLE } from "../pages/experiments/document";
import { Figures } from "../pages/experiments/ExperimentRuns";
import { SequenceEditor } from "../pages/experiments/SequenceEditor";
import { limitLines } from "../pages/operate/LiveCharts";
import { SettingsCard } from "../pages/runs/RunDetail";
import type { AngleUnit } from "../samples/quantity";
import { AngleUnitContext } from "../service/api/preferences";
import { PANELS, POSITION, readIn } from "../theme/layouts";
import type { Criterion, Limits, Metric, Run, Setting } from "../wire/types";
import { NumberField, SettingField } from "./fields";
import { LocalizedText } from "./values";

/** π/3, a sixth of a turn. */
const SIXTH = 1.0471975511965976;

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});
afterEach(cleanup);

function open(element: ReactElement, angles: AngleUnit = "deg"): void {
  render(
    <MantineProvider>
      <AngleUnitContext value={angles}>{element}</AngleUnitContext>
    </MantineProvider>,
  );
}

const box = () => screen.getByRole("textbox") as HTMLInputElement;
const text = () => document.body.textContent ?? "";

function Box({ seen }: { seen: (value: number | string) => void }) {
  const [value, setValue] = useState<number | string>(SIXTH);
  seen(value);
  return <NumberField label="angle" unit="rad" value={value} onChange={setValue} />;
}

it("accepts degrees in a box, sends radians, and shows the typed number again", () => {
  const seen = vi.fn();
  open(<Box seen={seen} />);
  expect(box().value).toBe("60");
  for (const [typed, turn] of [
    ["120", 1 / 3],
    ["-12.345", -12.345 / 360],
    ["1e1", 1 / 36],
  ] as const) {
    fireEvent.change(box(), { target: { value: typed } });
    expect(seen.mock.lastCall?.[0]).toBeCloseTo(2 * Math.PI * turn, 14);
    fireEvent.blur(box());
    expect(Number(box().value)).toBe(Number(typed));
  }
});

it("accepts radians if the person chose them, and shows at most six digits of other values", () => {
  const seen = vi.fn();
  open(<Box seen={seen} />, "rad");
  expect(box().value).toBe("1.0472");
  expect(seen).toHaveBeenLastCalledWith(SIXTH);
  fireEvent.change(box(), { target: { value: "1.5" } });
  expect(seen).toHaveBeenLastCalledWith(1.5);
});

const AMPLITUDE = {
  name: "q_amplitude",
  meaning: "joint position steps",
  unit: "rad",
  default: SIXTH,
  minimum: 0.01,
  maximum: 1.4,
} as Setting;

it.each([
  ["deg", "Joint position steps [°]", "0.573 to 80.2"],
  ["rad", "Joint position steps [rad]", "0.01 to 1.4"],
] as const)("labels a setting and its range in %s", (angles, label, range) => {
  open(<SettingField setting={AMPLITUDE} value={SIXTH} onChange={() => undefined} />, angles);
  expect(screen.getByLabelText(label)).toBe(box());
  expect(text()).toContain(range);
});

it("converts according to the unit and not the name", () => {
  open(
    <SettingField setting={{ ...AMPLITUDE, unit: "N·m/rad" }} value={10} onChange={() => undefined} />,
    "deg",
  );
  expect(screen.getByLabelText("Joint position steps [N·m/rad]")).toBe(box());
  expect(text()).toContain("0.01 to 1.4");
  expect(box().value).toBe("10");
});

it.each([
  ["deg", "q_ref [°]", "60"],
  ["rad", "q_ref [rad]", "1.0472"],
] as const)("edits parts and shows settings in %s", (angles, heading, value) => {
  const parts = [{ do: "step", q_ref: SIXTH, duration_s: 4 }];
  const document = { ...SAMPLE, phases: [{ name: "all", title: "All", parts }] };
  open(<SequenceEditor document={document} played={[]} onChange={() => undefined} />, angles);
  expect((screen.getByLabelText(`${heading} of part 1.1`) as HTMLInputElement).value).toBe(value);
  cleanup();
  const settings = [
    { name: "q_hold", symbol: "q_0", unit: "rad", meaning: "position held", value: SIXTH },
  ] as Run["settings"];
  open(<SettingsCard settings={settings} />, angles);
  const row = screen.getByRole("row", { name: /position held/ });
  expect(row.textContent).toBe(`position heldq_0${value}${angles === "deg" ? "°" : "rad"}`);
});

it.each([
  ["deg", "5.730°", "< 11.4592°", "q stood at 91.79°"],
  ["rad", "0.1000rad", "< 0.2 rad", "q stood at 1.602 rad"],
] as const)("shows metrics, bounds and reasons in %s", (angles, figure, bound, reason) => {
  const of = { unit: "rad", definition: "", reason: "q stood at 1.602\u202frad" };
  const metric = { ...of, name: "deviation_q", label: "Joint deviation", value: 0.1 } as Metric;
  const criterion = {
    ...of,
    name: "d",
    label: "Deviation",
    value: 0.1,
    relation: "<",
    bound: 0.2,
    passed: true,
  };
  open(<Figures criteria={[criterion as Criterion]} metrics={[metric]} />, angles);
  const metrics = within(screen.getByRole("table", { name: "Metrics" }));
  expect(metrics.getByRole("row", { name: /Joint deviation/ }).textContent).toContain(figure);
  expect(text()).toContain(bound);
  expect(text()).toContain(reason);
});

it("draws charts of angles, with limits and readouts, in the person's unit", () => {
  const [degrees, radians] = [readIn(POSITION, "deg"), readIn(POSITION, "rad")];
  expect([degrees.unit, degrees.decimals, radians.unit, radians.decimals]).toEqual(["°", 2, "rad", 4]);
  expect(degrees.factor * SIXTH).toBeCloseTo(60, 12);
  expect(degrees.narrowest).toBeCloseTo(4, 12);
  expect(radians.factor).toBe(1);
  for (const panel of PANELS.filter((other) => other !== POSITION)) {
    expect(readIn(panel, "deg")).toEqual(readIn(panel, "rad"));
  }
  const forces = { S_min: 8, S_max: 15, F_min: 0.5, F_max: 47.5, u_max: 7 };
  const limits = { q_min: -SIXTH, q_max: SIXTH, ...forces } as Limits;
  const lines = (angles: AngleUnit) =>
    limitLines(limits, angles)
      .filter(({ of }) => of.includes("q"))
      .map(({ value }) => value);
  expect(lines("rad")).toEqual([-SIXTH, SIXTH]);
  expect(lines("deg")[1]).toBeCloseTo(60, 12);
});

it("shows a text of the service in the person's unit", () => {
  open(<LocalizedText text={"q = 1.602\u202frad, S = 10 N·m/rad"} />);
  expect(text()).toContain("q = 91.79°, S = 10 N·m/rad");
});
