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
    updates: readonly (readonly [ReturnType<typeof holder> | null, mine: number | null, givenUp?: number])[],
  ): ControlState {
    return updates.reduce(
      (before, [who, mine, givenUp]) => nextControlState(before, who, mine, givenUp ?? null, 5),
      NO_CONTROL,
    );
  }

  it("names the person who took control, also after control has changed again", () => {
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

  it("states that control ended if nobody took it", () => {
    const { lost } = play([
      [holder(7), 7],
      [null, 7],
    ]);
    expect(lost).toEqual({ to: null, at_ms: 5 });
    expect(describeLoss({ to: null })).toBe(TEXTS.lossUnheard);
  });

  it("reports no loss once this page has control again", () => {
    expect(
      play([
        [holder(7), 7],
        [holder(8, "Ben"), 7],
        [holder(9), 9],
      ]),
    ).toEqual({ had: 9, lost: null });
  });

  it("reports no loss of control that the page released, never had, or is about to receive", () => {
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
    // control taken, and an earlier state arrives afterwards
    expect(
      play([
        [holder(8, "Ben"), 9],
        [holder(9), 9],
      ]),
    ).toEqual({ had: 9, lost: null });
    // the page was loaded again under another key, or took control from itself
    expect(
      play([
        [holder(7), 7],
        [holder(7), 8],
        [holder(8), 8],
      ]),
    ).toEqual({ had: 8, lost: null });
  });
});

describe("whyNoControl", () => {
  const HOLDER = { name: "Mara Stein", epoch: 7, page: true, lost: false } as NonNullable<State["holder"]>;

  it("names the holder of control; null if this page has control or may take it", () => {
    expect(whyNoControl(HOLDER, null)).toBe(fillText(TEXTS.hasControl, { name: "Mara Stein" }));
    expect(whyNoControl({ ...HOLDER, page: false }, null)).toBe(
      fillText(TEXTS.scriptHasControl, { name: "Mara Stein" }),
    );
    expect(whyNoControl(HOLDER, 6)).toBe(fillText(TEXTS.hasControl, { name: "Mara Stein" }));
    expect(whyNoControl(HOLDER, 7)).toBeNull();
    expect(whyNoControl(HOLDER, 8)).toBeNull(); // control taken, and the state is older
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
