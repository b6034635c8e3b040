import { expect, test } from "vitest";
import { beside, type Document, documentIn, moved, numberOf, SAMPLE, writeDocument } from "./document";
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

/** Names of the parts in the order in which they stand, loops in brackets. */
function order(document: Document): string {
  const of = (parts: readonly Record<string, unknown>[]): string =>
    parts.map((part) => (part.do === "repeat" ? `[${of(part.parts as [])}]` : part.duration_s)).join("");
  return document.phases.map(({ parts }) => of(parts)).join("|");
}

test("what is written is what is read, and no part is split over lines", () => {
  const text = writeDocument(LOOPED);
  expect(documentIn(text)).toEqual(LOOPED);
  expect(text).toContain('\n        {"do":"hold","duration_s":1},\n');
});

test("a part goes down through a loop and on into the next phase, and the same way back", () => {
  const seen = ["1[23]4|5"];
  let [document, place] = [LOOPED, ["phases", 0, "parts", 0] as readonly (string | number)[]];
  const go = (by: -1 | 1) => {
    for (let to = beside(document, place, by); to !== null; to = beside(document, place, by)) {
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

test("a loop is not dropped into itself", () => {
  const loop = ["phases", 0, "parts", 1];
  expect(moved(LOOPED, loop, [...loop, "parts", 0])).toEqual([LOOPED, loop]);
});

test("a part dropped before one of another list is there", () => {
  const [document, place] = moved(LOOPED, ["phases", 1, "parts", 0], ["phases", 0, "parts", 1, "parts", 1]);
  expect(order(document)).toBe("1[253]4|");
  expect(numberOf(place)).toBe("1.2.2");
});

test("a step that becomes a ramp goes to the same place, in the same time", () => {
  const step = { do: "step", S_ref: 12, duration_s: 3 };
  expect(partOf("ramp", step)).toEqual({ do: "ramp", S_ref: 12, duration_s: 3 });
  // a sine is one whole period of the time that the part took, not half of one
  expect(partOf("sine", step)).toEqual({ do: "sine", q_amplitude: 0.2, period_s: 3, duration_s: 3 });
  expect(partOf("sine")).toMatchObject({ period_s: 4, duration_s: 8 });
  expect(Object.keys(PART_FORMS).map((kind) => partOf(kind).do)).toEqual(Object.keys(PART_FORMS));
});
