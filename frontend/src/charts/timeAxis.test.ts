import { expect, it } from "vitest";
import { printedTime, splitsOf, stepFor, timeText, timeTitle } from "./plot";

it("has its lines at round times since the start", () => {
  expect(splitsOf(-0.5, 10.2, 5, null)).toEqual([0, 5, 10]);
  expect(splitsOf(2, 2.001, 5, null)).toEqual([]);
});

it.each([1, 5, 15, 60, 300])("has its lines at round times of the day, %d s apart", (step_s) => {
  const epoch_s = new Date(2026, 2, 1, 14, 5, 9, 370).getTime() / 1000;
  const splits = splitsOf(0, 5 * step_s, step_s, epoch_s);
  expect(splits.length).toBeGreaterThanOrEqual(5);
  for (const split of splits) {
    const when = new Date(1000 * (epoch_s + split));
    const seconds = 3600 * when.getHours() + 60 * when.getMinutes() + when.getSeconds();
    expect(Math.abs(when.getMilliseconds() - 500)).toBeGreaterThan(497);
    expect((seconds + (when.getMilliseconds() > 500 ? 1 : 0)) % step_s).toBe(0);
  }
});

it("tells a moment in the one way or the other", () => {
  const epoch_s = new Date(2026, 2, 1, 14, 5, 9).getTime() / 1000;
  expect(timeText(61.5, 0.1, null)).toBe("1:01.5");
  expect(timeText(61.5, 0.1, epoch_s)).toBe("14:06:10.5");
});

it("is printed in seconds with their unit, or as the time of day", () => {
  const epoch_s = new Date(2026, 2, 1, 14, 5, 9).getTime() / 1000;
  expect([printedTime(605, 5, null), timeTitle(null)]).toEqual(["605", "time since the start [s]"]);
  expect(printedTime(-0.25, 0.05, null)).toBe("−0.25");
  expect([printedTime(61.5, 0.1, epoch_s), timeTitle(epoch_s)]).toEqual(["14:06:10.5", "time of day"]);
});

it("takes the finest distance for which there is room", () => {
  expect(stepFor(20, 700, 70)).toBe(2);
  expect(stepFor(20, 690, 70)).toBe(5);
});
