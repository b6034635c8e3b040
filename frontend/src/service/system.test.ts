import { expect, it, vi } from "vitest";

// the REST client takes hold of fetch when it is made
vi.hoisted(() => vi.stubGlobal("fetch", () => new Promise(() => {})));

import type { Flight } from "../wire/types";
import { flightOf } from "./system";

const FLIGHT: Flight = {
  id: 5,
  at: "2026-03-04T10:20:30Z",
  kind: "trip",
  who: "",
  fault: "tension",
  text: "",
  run: null,
  tick: 10_000,
  before_s: 10,
  after_s: 5,
};

it("is the newest record, where the fault's tick is within the seconds after its trip", () => {
  const flights = [FLIGHT, { ...FLIGHT, id: 4, tick: 2_000 }];
  expect(flightOf(flights, { tick: 10_000 })?.id).toBe(5);
  expect(flightOf(flights, { tick: 14_999 })?.id).toBe(5);
  expect(flightOf(flights, { tick: 15_001 })).toBeUndefined();
  expect(flightOf(flights, { tick: 9_999 })).toBeUndefined();
  expect(flightOf(flights, { tick: 2_000 })).toBeUndefined();
  expect(flightOf(flights, null)).toBeUndefined();
  expect(flightOf([], { tick: 1 })).toBeUndefined();
  const trigger: Flight = { ...FLIGHT, id: 6, kind: "trigger", tick: 10_500 };
  expect(flightOf([trigger, ...flights], { tick: 11_000 })?.id).toBe(5);
  expect(flightOf([trigger], { tick: 11_000 })).toBeUndefined();
});
