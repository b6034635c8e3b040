import { expect, it } from "vitest";
import { scatter, steps } from "./metricScatter";

const DAY_MS = 86_400_000;

it("puts points between round numbers, in order of their dates", () => {
  const points = [3.2, 4.9, 4.1].map((value, index) => ({ run: index + 1, at: index * 10 * DAY_MS, value }));
  const drawn = scatter(points, 800, 360);
  const [first, second, third] = drawn.points;
  expect([first?.x, third?.x]).toEqual([64, 788]);
  expect(second?.x).toBeCloseTo((64 + 788) / 2);
  const ticks = drawn.values.map(({ label }) => Number(label));
  expect([ticks[0], ticks.at(-1)]).toEqual([3, 5]);
  const [low, high] = [drawn.values[0]?.at ?? 0, drawn.values.at(-1)?.at ?? 0];
  for (const { y, value } of drawn.points) expect(y).toBeCloseTo(low + ((value - 3) / 2) * (high - low));
  expect(drawn.dates[0]?.label).toBe("1970-01-01");
  expect(drawn.dates.at(-1)?.label).toBe("1970-01-21");
  expect(drawn.line.match(/[ML]/g)?.join("")).toBe("MLL");
});

it("draws a single point, equal ones and none", () => {
  const one = scatter([{ run: 1, at: DAY_MS, value: 0 }], 800, 360).points[0];
  expect(one?.x).toBeCloseTo((64 + 788) / 2);
  expect(Number.isFinite(one?.y)).toBe(true);
  expect(scatter([], 800, 360).points).toEqual([]);
  expect(scatter([{ run: 1, at: 0, value: 1 }], 0, 360).points).toEqual([]);
});

it("chooses round steps", () => {
  expect(steps(0.013, 0.087, 5)).toEqual([0, 0.02, 0.04, 0.06, 0.08, 0.1]);
  expect(steps(-3, 7, 5)).toEqual([-4, -2, 0, 2, 4, 6, 8]);
});
