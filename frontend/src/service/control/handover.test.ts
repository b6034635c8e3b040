import { expect, it } from "vitest";
import type { HandoverRequest } from "../../wire/types";
import { noticeOf, othersToGetControl } from "./handover";

const REQUEST: HandoverRequest = {
  number: 7,
  name: "Vera",
  by: "Ana",
  reason: "my sweep",
  standing: "asked",
  answer: "",
  offered: false,
  epoch: null,
};

function read(part: Partial<HandoverRequest>, me: string, holds = false): string {
  const notice = noticeOf({ ...REQUEST, ...part }, me, holds);
  return notice === null ? "nothing" : `${notice.text} [${notice.actions.join()}]`;
}

it("shows a request with its reason on the page in control, also under another name", () => {
  expect(read({}, "Ana", true)).toBe("Vera asks for control: “my sweep” [answer]");
  expect(read({ by: "another" }, "Ana", true)).toBe("Vera asks for control: “my sweep” [answer]");
  expect(read({}, "Oda")).toBe("nothing");
});

it("shows the result of a request to the person who asked", () => {
  expect(read({}, "Vera")).toBe("You asked Ana for control. [withdraw]");
  expect(read({ standing: "declined", answer: "ten minutes" }, "Vera")).toBe(
    "Ana keeps control: “ten minutes” [read]",
  );
  expect(read({ standing: "lapsed" }, "Vera")).toBe("Ana has not answered. Ask again, or take over. [read]");
  expect(read({ standing: "freed" }, "Vera")).toBe("Ana no longer has control. [read]");
  expect(read({ standing: "taken" }, "Vera")).toBe("Ana has handed control over to you. [read]");
  expect(read({ standing: "withdrawn" }, "Vera")).toBe("nothing");
});

it("lets the recipient take or decline an offer, and its sender withdraw it", () => {
  const offered = { standing: "offered", offered: true } as const;
  expect(read(offered, "Vera")).toBe("Ana offers you control: “my sweep” [take,decline]");
  expect(read(offered, "Ana", true)).toBe(
    "You offered control to Vera. You keep it until Vera takes it. [withdraw]",
  );
  expect(read({ ...offered, standing: "declined", answer: "" }, "Ana", true)).toBe(
    "Vera did not take control. [read]",
  );
});

it("lists only other operators for a handover", () => {
  const people = (["Ana", "Vera", "Vic (viewer)"] as const).map((name) => ({
    name,
    role: name.includes("viewer") ? ("viewer" as const) : ("operator" as const),
    pages: 1,
    since: "2026-01-09T07:05:03Z",
  }));
  expect(othersToGetControl(people, "Ana")).toEqual(["Vera"]);
});
