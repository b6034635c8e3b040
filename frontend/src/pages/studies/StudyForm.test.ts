import { expect, it } from "vitest";
import { asStudy, EMPTY_STUDY, type StudyDocument, valuesIn, writeStudy } from "./StudyForm";

it("writes each axis on its own line", () => {
  const study: StudyDocument = {
    ...EMPTY_STUDY,
    title: "Both λ: a map",
    axes: [
      { over: "lam_q", first: 0.4, last: 1, count: 5 },
      { over: "interpolate", values: [true, false] },
    ],
    spread: [{ of: "motor.c0", relative: 0.2 }],
    draws: 4,
  };
  expect(writeStudy(study)).toBe(`format: 1
name: mine
title: "Both λ: a map"
experiment: tracking
settings: {motion: lambda}
axes:
  - {over: lam_q, first: 0.4, last: 1, count: 5}
  - {over: interpolate, values: [true, false]}
spread:
  - {of: motor.c0, relative: 0.2}
draws: 4
`);
});

it("quotes strings that YAML would read as another type", () => {
  const written = writeStudy({ ...EMPTY_STUDY, name: "true", title: "1e3", experiment: "composed@2" });
  expect(written).toContain('name: "true"');
  expect(written).toContain('title: "1e3"');
  expect(written).toContain("experiment: composed@2");
});

it("writes fields that the form does not show, and omits undefined ones", () => {
  const written = writeStudy({
    ...EMPTY_STUDY,
    description: "why",
    seeds: undefined,
    axes: [],
  } as StudyDocument);
  expect(written).toContain("description: why");
  expect(written).not.toContain("seeds");
  expect(written).not.toContain("axes");
});

it("accepts a study, and rejects documents that the form cannot show", () => {
  expect(asStudy({ name: "a", title: "A" })).not.toBeNull();
  for (const other of [
    null,
    1,
    [],
    { axes: 1 },
    { axes: [1] },
    { axes: [{ values: 2 }] },
    { settings: [] },
    { name: 1 },
  ]) {
    expect(asStudy(other)).toBeNull();
  }
});

it("reads lists of values with a unit conversion", () => {
  expect(valuesIn("1, 2.5;x true", (word) => (word === "x" ? null : Number(word) * 10))).toEqual([
    10,
    25,
    "x",
    true,
  ]);
});
