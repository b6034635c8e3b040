import { expect, it } from "vitest";
import { afterTold, type ControlKept, lossSentence, NO_CONTROL } from "./control";

const holder = (epoch: number, name = "Ana") => ({ name, epoch, page: true, silent_s: 0, lost: false });

function play(
  told: readonly (readonly [ReturnType<typeof holder> | null, mine: number | null, givenUp?: number])[],
): ControlKept {
  return told.reduce(
    (kept, [who, mine, givenUp]) => afterTold(kept, who, mine, givenUp ?? null, 5),
    NO_CONTROL,
  );
}

it("says who took over, and goes on saying so whoever holds control then", () => {
  const lost = play([
    [holder(7), 7],
    [holder(8, "Ben"), 7],
  ]);
  expect(lost.lost).toEqual({ to: "Ben", at_ms: 5 });
  expect(lossSentence({ to: "Ben" })).toContain("Ben has taken over");
  expect(
    play([
      [holder(7), 7],
      [holder(8, "Ben"), 7],
      [holder(8, "Ben"), null],
      [null, null],
    ]).lost?.to,
  ).toBe("Ben");
});

it("says that control ended where nobody took it", () => {
  const { lost } = play([
    [holder(7), 7],
    [null, 7],
  ]);
  expect(lost).toEqual({ to: null, at_ms: 5 });
  expect(lossSentence({ to: null })).toContain("has ended");
});

it("has nothing to say once this page holds control again", () => {
  expect(
    play([
      [holder(7), 7],
      [holder(8, "Ben"), 7],
      [holder(9), 9],
    ]),
  ).toEqual({ had: 9, lost: null });
});

it("does not call lost what was given up, never had, or is on its way", () => {
  expect(
    play([
      [holder(7), 7],
      [null, null, 7],
    ]).lost,
  ).toBeNull();
  expect(
    play([
      [holder(7), 7],
      [holder(7), null, 7],
      [holder(8, "Ben"), null, 7],
    ]).lost,
  ).toBeNull();
  expect(
    play([
      [holder(8, "Ben"), null],
      [null, null],
    ]).lost,
  ).toBeNull();
  // taken, but the state of before comes once more
  expect(
    play([
      [holder(8, "Ben"), 9],
      [holder(9), 9],
    ]),
  ).toEqual({ had: 9, lost: null });
  // the page was loaded again under another key, or took over its own control
  expect(
    play([
      [holder(7), 7],
      [holder(7), 8],
      [holder(8), 8],
    ]),
  ).toEqual({ had: 8, lost: null });
});
