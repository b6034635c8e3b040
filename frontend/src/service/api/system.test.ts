import { expect, test } from "vitest";
import { RequestError } from "../../wire/client";
import { addressCheckOf } from "./system";

test("returns the problems that the service finds", async () => {
  expect(await addressCheckOf(Promise.resolve({ problems: [] }))).toEqual({ problems: [], isAnswered: true });
  const found = await addressCheckOf(Promise.resolve({ problems: [{ message: "wrong path" }] }));
  expect(found).toEqual({ problems: ["wrong path"], isAnswered: true });
});

test("returns the message of a refusal as the problem", async () => {
  const refused = new RequestError("other origin", 403, { code: "foreign_origin", message: "other origin" });
  expect(await addressCheckOf(Promise.reject(refused))).toEqual({
    problems: ["other origin"],
    isAnswered: false,
  });
});

test.each([404, 405, 502])("attributes status %d without a problem to a proxy", async (status) => {
  const { problems, isAnswered } = await addressCheckOf(Promise.reject(new RequestError("?", status)));
  expect([problems.length, isAnswered]).toEqual([1, false]);
  expect(problems[0]).toContain(`${status}`);
  expect(problems[0]).not.toContain("cookies");
});

test("mentions cookies when a proxy refuses large headers", async () => {
  const { problems } = await addressCheckOf(Promise.reject(new RequestError("?", 400)));
  expect(problems[0]).toContain("cookies");
});

test("reports no problem of the address when the service is unreachable", async () => {
  const unreachable = await addressCheckOf(Promise.reject(new RequestError("no answer", 0)));
  expect(unreachable).toEqual({ problems: [], isAnswered: false });
});
