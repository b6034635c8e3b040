import { MantineProvider } from "@mantine/core";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { Tuning } from "../../wire/types";
import { PlanControl } from "./PlanControl";

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});
afterEach(cleanup);

function open(u_plan: number) {
  const drafted = vi.fn();
  const sent = vi.fn(() => new Promise(() => {}));
  const tuning = { u_plan, u_plan_min: 2, u_plan_max: 9, u_plan_usual: 8.5 } as Tuning;
  render(
    <MantineProvider>
      <LiveProvider store={new LiveStore(0)}>
        <PlanControl tuning={tuning} disabled={false} onDraft={drafted} onCommit={sent} />
      </LiveProvider>
    </MantineProvider>,
  );
  return { drafted, sent };
}

const box = () => screen.getByRole("textbox");

it("tells the forecast what is typed before it is sent, and that it was given up", () => {
  const { drafted, sent } = open(8.5);
  expect(drafted).toHaveBeenLastCalledWith(undefined);
  fireEvent.change(box(), { target: { value: "4.2" } });
  expect(drafted).toHaveBeenLastCalledWith(4.2);
  fireEvent.change(box(), { target: { value: "4.x" } });
  expect(drafted).toHaveBeenLastCalledWith(undefined);
  fireEvent.change(box(), { target: { value: "4" } });
  fireEvent.keyDown(box(), { key: "Escape" });
  expect(drafted).toHaveBeenLastCalledWith(undefined);
  expect(sent).not.toHaveBeenCalled();
});

it("keeps the forecast at what was sent until that is in force", () => {
  const { drafted, sent } = open(8.5);
  fireEvent.change(box(), { target: { value: "4.2" } });
  fireEvent.keyDown(box(), { key: "Enter" });
  expect(sent.mock.calls).toEqual([[4.2]]);
  expect(drafted).toHaveBeenLastCalledWith(4.2);
});

it("forecasts the usual budget as soon as the plan is switched on", () => {
  const { drafted, sent } = open(0);
  fireEvent.click(screen.getByRole("switch"));
  expect(sent.mock.calls).toEqual([[8.5]]);
  expect(drafted).toHaveBeenLastCalledWith(8.5);
});
