import { expect, it } from "vitest";
import { fillText } from "../../samples/texts";
import type { OwnExperiment } from "../../wire/types";
import { isOpened, NOTHING_OPENED, savedMeanwhile } from "./OwnExperiments";
import { TEXTS } from "./texts";

const version = (number: number, who: string): OwnExperiment => ({
  name: "mine",
  version: number,
  title: "Mine",
  who,
  created: "2031-05-01T08:00:00Z",
});
const OPENED = { ...NOTHING_OPENED, name: "mine", newest: 2 };

it("asks only if somebody has saved another version since", () => {
  expect(savedMeanwhile(OPENED, "mine", [version(2, "Mara"), version(1, "Mara")])).toBeNull();
  const asked = savedMeanwhile(OPENED, "mine", [version(3, "Vera"), version(2, "Mara")]);
  expect(asked).toContain(fillText(TEXTS.savedMeanwhile, { person: "Vera", version: 3, name: "mine" }));
  expect(asked).toContain(fillText(TEXTS.saveAdds, { problem: "", next: 4, version: 3 }).trim());
});

it("asks if another experiment has the name", () => {
  expect(savedMeanwhile(NOTHING_OPENED, "mine", [version(1, "Vera")])).toContain(
    fillText(TEXTS.nameTaken, { name: "mine", person: "Vera", version: 1 }),
  );
  expect(savedMeanwhile({ ...OPENED, name: "other" }, "mine", [version(1, "Vera")])).toContain(
    fillText(TEXTS.nameTaken, { name: "mine", person: "Vera", version: 1 }),
  );
  expect(savedMeanwhile(OPENED, "new", [])).toBeNull();
});

it("accepts its own stored data only", () => {
  expect(isOpened(NOTHING_OPENED)).toBe(true);
  expect(isOpened(JSON.parse(JSON.stringify(OPENED)))).toBe(true);
  for (const other of [null, 1, {}, { ...OPENED, newest: "2" }, { ...OPENED, document: { phases: 1 } }]) {
    expect(isOpened(other)).toBe(false);
  }
});
