import { expect, it } from "vitest";
import { figuresOf, spectraOf } from "./figures";

const PERIOD_S = 0.001;
const t = Float64Array.from({ length: 1000 }, (_, row) => row * PERIOD_S);
const sine = t.map((time) => Math.sin(2 * Math.PI * 50 * time));
const holed = sine.map((value, row) => (row < 400 ? Number.NaN : value));
const column = (name: string, values: Float64Array) => ({ name, minimum: values, maximum: values });
const raw = { raw: true, width_s: PERIOD_S, t, columns: [column("q", sine), column("S", holed)] };

it("says from how many samples statistics are, and how many have no value", () => {
  const { basis, signals } = figuresOf(raw);
  const range = { from_s: 0, to_s: 0.999 };
  expect(basis).toEqual([{ of: "", range, samples: 1000, missing: 0, bucket_s: null }]);
  expect(signals.get("S")).toMatchObject({ values: 600, withoutValue: 400 });
});

it("has extremes alone of an envelope, whose buckets it tells", () => {
  const { basis, signals } = figuresOf({ ...raw, raw: false, width_s: 0.1 });
  expect(basis[0]?.bucket_s).toBe(0.1);
  expect(signals.get("q")?.mean).toBeNaN();
  expect(signals.get("q")?.maximum).toBeCloseTo(1, 9);
});

it("says which samples a spectrum is of, and why there is none", () => {
  const { signals, reasons } = spectraOf(raw, ["q", "S", "F_A"], PERIOD_S);
  expect(signals.get("q")).toMatchObject({
    segment: 256,
    segments: 6,
    used: 896,
    values: 1000,
    withoutValue: 0,
  });
  expect(signals.get("S")).toMatchObject({
    segment: 256,
    segments: 3,
    used: 512,
    values: 600,
    withoutValue: 400,
  });
  expect([...reasons.keys()]).toEqual(["F_A"]);
  expect(spectraOf({ ...raw, raw: false }, ["q"], PERIOD_S).reasons.has("q")).toBe(true);
});
