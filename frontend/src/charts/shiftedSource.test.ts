import { expect, it } from "vitest";
import { panelsOf, STANDARD } from "../theme/layouts";
import type { Panel } from "../theme/signals";
import { RecordedSource, ShiftedSource } from "./sources";

const DURATION_S = 4;
const POSITION = panelsOf(STANDARD)[0] as Panel;

/** q is its own time: 0, 1, 2, 3. */
function recording(): RecordedSource {
  const source = new RecordedSource(DURATION_S);
  const q = Float32Array.from([0, 1, 2, 3]);
  source.setOverview({
    raw: true,
    width_s: 1,
    t: Float64Array.from([0, 1, 2, 3]),
    signals: { q: { minimum: q, maximum: q } },
  });
  return source;
}

it("tells of each moment what the recording tells of its own, and nothing before or after it", () => {
  const shifted = new ShiftedSource(recording(), -1.5);
  expect([shifted.first_s(), shifted.now_s()]).toEqual([-1.5, 2.5]);
  expect(shifted.at("q", 0.5)).toBe(2);
  expect(shifted.at("q", -1.5)).toBe(0);
  expect(shifted.at("q", -1.6)).toBeNaN();
  expect(shifted.at("q", 2.6)).toBeNaN();
  const { times, values } = shifted.curves(POSITION, { from_s: -2, to_s: 3 }, 100);
  expect(Array.from(times)).toEqual([-1.5, -0.5, 0.5, 1.5]);
  expect(Array.from(values[1] ?? [])).toEqual([0, 1, 2, 3]);
  const { t, columns } = shifted.table(["q"], { from_s: -0.6, to_s: 0.6 });
  expect(Array.from(t)).toEqual([-0.5, 0.5]);
  expect(Array.from(columns[0]?.minimum ?? [])).toEqual([1, 2]);
});
