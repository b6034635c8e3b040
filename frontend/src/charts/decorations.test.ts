import { describe, expect, it } from "vitest";
import { labelsOf, marksNear, type PlacedMark } from "./decorations";

const mark = (time_s: number, text: string, fault = false): PlacedMark => ({ time_s, text, fault });
/** Ten pixels per letter, and per second. */
const widthOf = (text: string) => 10 * text.length;
const labels = (marks: readonly PlacedMark[], right = 1000) =>
  labelsOf(
    marks.map((one) => ({ mark: one, x: 10 * one.time_s })),
    right,
    5,
    widthOf,
  );

describe("labels of marks", () => {
  it("are complete if there is space", () => {
    const long = "a push of 5.0 N that lasts for half a second";
    expect(labels([mark(0, long)])).toEqual([{ text: long, x: 0, fault: false }]);
  });

  it("count marks that are too close, and name a fault first", () => {
    const close = [mark(10, "mode run"), mark(10.5, "trip", true), mark(11, "recording ended")];
    expect(labels(close).map(({ text, fault }) => [text, fault])).toEqual([["trip +2", true]]);
  });

  it("name a change of the mode before other marks at that time", () => {
    const change: PlacedMark = { ...mark(10.5, "mode run"), mode: true };
    expect(labels([mark(10, "control taken"), change]).map(({ text }) => text)).toEqual(["mode run +1"]);
    expect(labels([change, mark(11, "trip", true)]).map(({ text }) => text)).toEqual(["trip +1"]);
  });

  it("never overlap each other or the edge", () => {
    const marks = Array.from({ length: 40 }, (_, n) => mark(2.4 * n, "a text of some length"));
    const found = labels(marks);
    for (const [index, { text, x }] of found.entries())
      expect(x + widthOf(text)).toBeLessThanOrEqual(found[index + 1]?.x ?? 1000);
    const last = labels([mark(0, "a text of some length"), mark(90, "a text of some length")]).at(-1);
    expect(last).toEqual({ text: "a text of some length", x: 1000 - 210, fault: false });
    const counted = found.reduce((sum, { text }) => sum + 1 + Number(/\+(\d+)$/.exec(text)?.[1] ?? 0), 0);
    expect(counted).toBe(marks.length);
  });
});

it("returns the marks near a time in the order of time", () => {
  const marks = [mark(3, "c"), mark(1, "a"), mark(2, "b"), mark(9, "far")];
  expect(marksNear(marks, 2, 1).map(({ text }) => text)).toEqual(["a", "b", "c"]);
});
