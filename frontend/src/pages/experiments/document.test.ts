import { expect, test } from "vitest";
import { type Document, documentIn, moved, neighbour, numberOf, SAMPLE, writeDocument } from "./document";
import { PART_FORMS, partOf } from "./PartList";

const DO = (kind: string, name: number) => ({ do: kind, duration_s: name });
const LOOPED: Document = {
  ...SAMPLE,
  phases: [
    {
      name: "a",
      title: "A",
      parts: [
        DO("hold", 1),
        { do: "repeat", times: 2, parts: [DO("hold", 2), DO("hold", 3)] },
        DO("hold", 4),
      ],
    },
    { name: "b", title: "B", parts: [DO("hold", 5)] },
  ],
};

/** Returns the durations of the parts in their order, loops in brackets. */
function order(document: Document): string {
  const of = (parts: readonly Record<string, unknown>[]): string =>
    parts.map((part) => (part.do === "repeat" ? `[${of(part.parts as [])}]` : part.duration_s)).join("");
  return document.phases.map(({ parts }) => of(parts)).join("|");
}

test("reads the document that it has written, and writes no part over several lines", () => {
  const text = writeDocument(LOOPED);
  expect(documentIn(text)).toEqual(LOOPED);
  expect(text).toContain('\n        {"do":"hold","duration_s":1},\n');
});

test("moves a part down through a loop into the next phase, and back along the same path", () => {
  const seen = ["1[23]4|5"];
  let [document, place] = [LOOPED, ["phases", 0, "parts", 0] as readonly (string | number)[]];
  const go = (by: -1 | 1) => {
    for (let to = neighbour(document, place, by); to !== null; to = neighbour(document, place, by)) {
      [document, place] = moved(document, place, to);
      seen.push(order(document));
    }
  };
  go(1);
  expect(seen).toEqual([
    "1[23]4|5",
    "[123]4|5",
    "[213]4|5",
    "[231]4|5",
    "[23]14|5",
    "[23]41|5",
    "[23]4|15",
    "[23]4|51",
  ]);
  expect(numberOf(place)).toBe("2.2");
  const down = seen.splice(0);
  go(-1);
  expect(seen).toEqual(down.toReversed().slice(1));
});

test("does not drop a loop into itself", () => {
  const loop = ["phases", 0, "parts", 1];
  expect(moved(LOOPED, loop, [...loop, "parts", 0])).toEqual([LOOPED, loop]);
});

test("moves a part to its target in another list", () => {
  const [document, place] = moved(LOOPED, ["phases", 1, "parts", 0], ["phases", 0, "parts", 1, "parts", 1]);
  expect(order(document)).toBe("1[253]4|");
  expect(numberOf(place)).toBe("1.2.2");
});

test("converts a step to a ramp with the same target and duration", () => {
  const step = { do: "step", S_ref: 12, duration_s: 3 };
  expect(partOf("ramp", step)).toEqual({ do: "ramp", S_ref: 12, duration_s: 3 });
  // a sine is one whole period with the duration of the part, not half a period
  expect(partOf("sine", step)).toEqual({ do: "sine", q_amplitude: 0.2, period_s: 3, duration_s: 3 });
  expect(partOf("sine")).toMatchObject({ period_s: 4, duration_s: 8 });
  expect(Object.keys(PART_FORMS).map((kind) => partOf(kind).do)).toEqual(Object.keys(PART_FORMS));
});
