import { describe, expect, it } from "vitest";
import { RequestError } from "../wire/client";
import { refusalText } from "./refusalText";

const SENTENCE = "q_ref = 2.094 rad is out of range";

describe("refusalText", () => {
  it("gives bounds in the unit of the input", () => {
    const problem = {
      code: "out_of_range",
      message: SENTENCE,
      value: 2.0944,
      minimum: -1.4008,
      maximum: 1.4008,
    };
    const error = new RequestError(SENTENCE, 422, problem);
    expect(refusalText(error, 180 / Math.PI, 1, "deg")).toBe("120.0 refused: outside −80.3 … 80.3 deg");
  });

  it("falls back to the service's sentence", () => {
    expect(refusalText(new RequestError(SENTENCE, 409, { code: "x", message: SENTENCE }), 1, 1, "s")).toBe(
      SENTENCE,
    );
    expect(refusalText(new Error("no answer"), 1, 1, "s")).toBe("no answer");
    expect(refusalText(null, 1, 1, "s")).toBeNull();
  });
});
