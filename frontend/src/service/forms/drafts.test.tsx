import { act, renderHook } from "@testing-library/react";
import { describe, expect, it, vi } from "vitest";
import { type DraftEvent, FOLLOWING, nextDraft, shown, useSentValue } from "./drafts";

describe("useSentValue", () => {
  interface Sending {
    readonly value: number;
    accept(): void;
    refuse(reason: string): void;
  }

  /** A service that answers only when the test calls `accept` or `refuse`. */
  function slowService() {
    const sent: Sending[] = [];
    const send = vi.fn(
      (value: number) =>
        new Promise<void>((resolve, reject) => {
          sent.push({ value, accept: resolve, refuse: (reason) => reject(new Error(reason)) });
        }),
    );
    return { sent, send };
  }

  function start(active: number) {
    const service = slowService();
    const hook = renderHook(({ now }) => useSentValue(now, service.send), { initialProps: { now: active } });
    return { ...service, ...hook };
  }

  it("sends on release only, and shows the active value afterwards", async () => {
    const { sent, send, result, rerender } = start(0.5);
    act(() => result.current.edit(0.6));
    expect(send).not.toHaveBeenCalled();
    act(() => result.current.commit(0.6));
    expect(result.current).toMatchObject({ value: 0.6, pending: true });
    await act(async () => sent[0]?.accept());
    rerender({ now: 0.59 });
    expect(result.current).toMatchObject({ value: 0.59, pending: false, refusal: null });
  });

  it("reverts to the active value on a refusal, and gives its reason", async () => {
    const { sent, result } = start(0.5);
    act(() => result.current.commit(9));
    await act(async () => sent[0]?.refuse("too slow"));
    expect(result.current.value).toBe(0.5);
    expect(result.current.refusal?.message).toBe("too slow");
  });

  it("sends one value at a time, and then only the newest of the waiting values", async () => {
    const { sent, send, result } = start(0.5);
    for (const value of [0.6, 0.7, 0.8, 0.9]) act(() => result.current.commit(value));
    expect(send).toHaveBeenCalledTimes(1);
    await act(async () => sent[0]?.accept());
    expect(send.mock.calls.map(([value]) => value)).toEqual([0.6, 0.9]);
    expect(result.current).toMatchObject({ value: 0.9, pending: true });
  });

  it("does not overwrite an edited value with a report", () => {
    const { result, rerender } = start(0.5);
    act(() => result.current.edit(0.8));
    rerender({ now: 0.4 });
    expect(result.current.value).toBe(0.8);
  });
});

describe("draft", () => {
  const played = (...events: DraftEvent[]) => events.reduce(nextDraft, FOLLOWING);

  describe("draft", () => {
    it("is not overwritten by reports during editing", () => {
      const draft = played({ kind: "edit", value: 12 }, { kind: "read-back" });
      expect(shown(draft, 5)).toBe(12);
    });

    it("shows a sent value until the service reports the active one", () => {
      const sent = played({ kind: "edit", value: 12 }, { kind: "send", value: 12 });
      expect(shown(sent, 5)).toBe(12);
      expect(shown(nextDraft(sent, { kind: "read-back" }), 11.9)).toBe(11.9);
    });

    it("reverts to the active value on a refusal", () => {
      expect(shown(played({ kind: "send", value: 99 }, { kind: "drop" }), 5)).toBe(5);
    });
  });
});
