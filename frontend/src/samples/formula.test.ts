import { afterEach, expect, it } from "vitest";
import type { Frame } from "../wire/liveMessages";
import { type DerivedSignal, derivedSignal, type Step, setDerived, valuesOf } from "./formula";
import cases from "./formulaCases.fixture.json";
import { SampleWindow } from "./window";

afterEach(() => setDerived([]));

interface Case {
  readonly expression: string;
  readonly columns: Readonly<Record<string, readonly (number | null)[]>>;
  readonly values: readonly (number | null)[];
  readonly steps: readonly Step[];
}

const LENGTHS = { r_m: 0.0075, r_j: 0.075 };

it.each(cases as unknown as readonly Case[])(
  "evaluates $expression like the service",
  ({ columns, values, steps }) => {
    const read = (name: string) => Float64Array.from(columns[name] ?? [], (value) => value ?? Number.NaN);
    const found = valuesOf(steps, values.length, read, LENGTHS);
    for (const [row, value] of values.entries()) {
      if (value === null) expect(found[row]).toBeNaN();
      else expect(found[row]).toBeCloseTo(value, 12);
    }
  },
);

it("returns NaN for an unknown operation", () => {
  const steps = [{ op: "cube", of: 1, value: 0, name: "" }];
  expect(
    valuesOf([{ op: "number", of: 0, value: 2, name: "" }, ...steps], 1, () => new Float64Array(1), LENGTHS),
  ).toEqual(Float64Array.of(Number.NaN));
});

function signal(name: string, steps: readonly Partial<Step>[], signals: readonly string[]): DerivedSignal {
  const whole = steps.map((step) => ({ op: "signal", of: 0, value: 0, name: "", ...step }));
  return { name, unit: "N", meaning: "", expression: "", signals, steps: whole };
}

const SUM = signal("F_sum", [{ name: "F_A" }, { name: "F_B" }, { op: "add", of: 2 }], ["F_A", "F_B"]);

function frame(firstTick: number, ...columns: number[][]): Frame {
  return {
    firstTick,
    count: columns[0]?.length ?? 0,
    missed: 0,
    columns: columns.map((one) => Float32Array.from(one)),
  };
}

it("is in the live window for stored samples, for each frame, and after the ring buffer wraps", () => {
  const window = new SampleWindow(["F_A", "F_B"], 32);
  window.append(frame(0, [1, 2, Number.NaN], [10, 20, 30]));
  window.derive([SUM]);
  expect([0, 1, 2].map((tick) => window.at("F_sum", tick))).toEqual([11, 22, Number.NaN]);
  const ramp = Array.from({ length: 40 }, (_, n) => n);
  window.append(frame(3, ramp, ramp));
  expect(window.newest("F_sum")).toBe(78);
  expect(window.at("F_sum", 42 - 10)).toBe(58);
  window.derive([]);
  expect(window.at("F_sum", 42)).toBeNaN();
});

it("is known by name once the station's formulas are set", () => {
  expect(derivedSignal("F_sum")).toBeUndefined();
  setDerived([SUM]);
  expect(derivedSignal("F_sum")?.unit).toBe("N");
});
