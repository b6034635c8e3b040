import { describe, expect, it } from "vitest";
import type { LiveStore } from "../live/store";
import { SampleWindow } from "../samples/window";
import { panelOf } from "../theme/layouts";
import { gridOf, type Plane, pointsOf, rangesFor } from "./PlaneFigure";
import { ComparedSource, LiveSource, RecordedSource } from "./sources";

const PLANE = panelOf({ title: "S over q", signals: ["S"], over: "q", share: 1 }) as Plane;
const q = (tick: number) => Math.fround(Math.cos(tick / 50));
const S = (tick: number) => Math.fround(10 + Math.sin(tick / 50));

function live(count: number): LiveSource {
  const window = new SampleWindow(["q", "S"], 16384);
  const column = (value: (tick: number) => number) =>
    Float32Array.from({ length: count }, (_, tick) => value(tick));
  window.append({ firstTick: 0, count, missed: 0, columns: [column(q), column(S)] });
  return new LiveSource({ window } as LiveStore);
}

function recorded(raw: boolean, of = S): RecordedSource {
  const source = new RecordedSource(1);
  const [first, width] = raw ? [0, 0.001] : [5, 0.01];
  const t = Float64Array.from({ length: raw ? 1000 : 100 }, (_, n) => n * width);
  const curve = (value: (tick: number) => number) => {
    const middle = Float32Array.from(t, (time) => value(1000 * time + first));
    return raw
      ? { minimum: middle, maximum: middle }
      : { minimum: middle.map((one) => one - 0.25), maximum: middle.map((one) => one + 0.25) };
  };
  source.setOverview({ raw, width_s: width, t, signals: { q: curve(q), S: curve(of) } });
  return source;
}

const trace = PLANE.traces[0] as Plane["traces"][number];

describe("points of one signal over another", () => {
  it("are samples of one time each, including the newest, for any number of samples", () => {
    const { x, y } = pointsOf(live(10_000), PLANE, trace, { from_s: 0, to_s: 9.9995 });
    expect(x.length).toBeLessThanOrEqual(3001);
    expect(x.length).toBeGreaterThan(1500);
    x.forEach((value, row) => {
      const tick = row === x.length - 1 ? 9999 : 4 * row;
      expect([value, y[row]]).toEqual([q(tick), S(tick)]);
    });
  });

  it("are the same while a view scrolls over them", () => {
    const source = live(10_000);
    const [a, b] = [0, 0.0013].map((from_s) => pointsOf(source, PLANE, trace, { from_s, to_s: from_s + 8 }));
    expect([...(b?.x.slice(0, 1900) ?? [])]).toEqual([...(a?.x.slice(1, 1901) ?? [])]);
  });

  it("are single samples of the recording, or the middles of buckets", () => {
    for (const raw of [true, false]) {
      const { x, y } = pointsOf(recorded(raw), PLANE, trace, { from_s: 0.2, to_s: 0.6 });
      expect(x).toHaveLength(raw ? 401 : 41);
      x.forEach((value, row) => {
        const tick = raw ? 200 + row : 205 + 10 * row;
        expect(value).toBeCloseTo(q(tick), 6);
        expect(y[row]).toBeCloseTo(S(tick), 6);
      });
    }
  });

  it("are from one recording when two are compared", () => {
    const other = (tick: number) => Math.fround(20 + Math.sin(tick / 50));
    const both = new ComparedSource(recorded(true), recorded(true, other));
    const { x, y } = pointsOf(both, PLANE, { ...trace, name: "S′" }, { from_s: 0.2, to_s: 0.6 });
    expect(x).toHaveLength(401);
    x.forEach((value, row) => {
      expect([value, y[row]]).toEqual([q(200 + row), other(200 + row)]);
    });
  });

  it("are in the units shown", () => {
    const degrees = { ...PLANE, over: { ...PLANE.over, factor: 180 / Math.PI } };
    const { x } = pointsOf(live(100), degrees, trace, { from_s: 0, to_s: 0.05 });
    expect(x[7]).toBeCloseTo((q(7) * 180) / Math.PI, 9);
  });
});

it("has axes that reach all points, with lines at round numbers", () => {
  const curve = { x: Float64Array.from([-1, 2]), y: Float64Array.from([8.1, 8.4, Number.NaN]) };
  const { x, y } = rangesFor(null, PLANE, [curve]);
  expect([x.min <= -1, x.max >= 2, y.min <= 8.1, y.max >= 8.4]).toEqual([true, true, true, true]);
  expect(y.max - y.min).toBeGreaterThanOrEqual(PLANE.narrowest);
  expect(gridOf({ min: -1, max: 1 }, 300, 70)).toEqual([
    [-1, "−1.0"],
    [-0.5, "−0.5"],
    [0, "0.0"],
    [0.5, "0.5"],
    [1, "1.0"],
  ]);
});
