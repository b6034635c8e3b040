import { describe, expect, it } from "vitest";
import { fillText } from "../../samples/texts";
import { RequestError } from "../../wire/client";
import type { State } from "../../wire/types";
import { isAboutControl } from "../forms/refusals";
import { TEXTS } from "../texts";
import { type ControlState, describeLoss, NO_CONTROL, nextControlState, whyNoControl } from "./control";

describe("control loss", () => {
  const holder = (epoch: number, name = "Ana") => ({ name, epoch, page: true, silent_s: 0, lost: false });

  function play(
    told: readonly (readonly [ReturnType<typeof holder> | null, mine: number | null, givenUp?: number])[],
  ): ControlState {
    return told.reduce(
      (kept, [who, mine, givenUp]) => nextControlState(kept, who, mine, givenUp ?? null, 5),
      NO_CONTROL,
    );
  }

  it("says who took over, and goes on saying so whoever holds control then", () => {
    const lost = play([
      [holder(7), 7],
      [holder(8, "Ben"), 7],
    ]);
    expect(lost.lost).toEqual({ to: "Ben", at_ms: 5 });
    expect(describeLoss({ to: "Ben" })).toBe(fillText(TEXTS.lossTakenOver, { name: "Ben" }));
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
    expect(describeLoss({ to: null })).toBe(TEXTS.lossUnheard);
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
});

describe("use no control", () => {
  const HOLDER = { name: "Mara Stein", epoch: 7, page: true, lost: false } as NonNullable<State["holder"]>;

  it("says who holds control, and nothing where this page commands or may take control", () => {
    expect(whyNoControl(HOLDER, null)).toBe(fillText(TEXTS.hasControl, { name: "Mara Stein" }));
    expect(whyNoControl({ ...HOLDER, page: false }, null)).toBe(
      fillText(TEXTS.scriptHasControl, { name: "Mara Stein" }),
    );
    expect(whyNoControl(HOLDER, 6)).toBe(fillText(TEXTS.hasControl, { name: "Mara Stein" }));
    expect(whyNoControl(HOLDER, 7)).toBeNull();
    expect(whyNoControl(HOLDER, 8)).toBeNull(); // taken already, and the state is of before
    expect(whyNoControl({ ...HOLDER, lost: true }, null)).toBeNull();
    expect(whyNoControl(null, 7)).toBeNull();
  });

  it("offers control for refusals about control only", () => {
    const refused = (code: string) =>
      new RequestError("no", 409, { code, message: "no" } as RequestError["problem"]);
    for (const code of ["control_held", "control_lost", "control_needed"])
      expect(isAboutControl(refused(code))).toBe(true);
    expect(isAboutControl(refused("not_in_this_mode"))).toBe(false);
    expect(isAboutControl(new Error("no"))).toBe(false);
    expect(isAboutControl(null)).toBe(false);
  });
});
