import { describe, expect, it } from "vitest";
import { resultIn } from "./lines";

/** An answer that comes in these pieces. */
function body(...pieces: readonly string[]): ReadableStream<Uint8Array> {
  const encoder = new TextEncoder();
  return new ReadableStream({
    start(controller) {
      for (const piece of pieces) controller.enqueue(encoder.encode(piece));
      controller.close();
    },
  });
}

describe("resultIn", () => {
  it("tells how far it is and returns the result, wherever the pieces are cut", async () => {
    const text = '{"share":0.5,"result":null}\n{"share":1,"result":{"unit":"N·m/rad"}}\n';
    for (let cut = 1; cut < text.length; cut++) {
      const shares: number[] = [];
      const found = await resultIn(body(text.slice(0, cut), text.slice(cut)), (share) => shares.push(share));
      expect(found).toEqual({ unit: "N·m/rad" });
      expect(shares).toEqual([0.5, 1]);
    }
  });

  it("does not take an answer that broke off for a result", async () => {
    await expect(resultIn(body('{"share":0.5}\n{"share":1,"res'), () => undefined)).rejects.toThrow(
      "before the result",
    );
  });
});
