import { MantineProvider } from "@mantine/core";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { Pushed, State, Tuning, TuningPreview } from "../../wire/types";
import { DisturbanceFeedforwardControl } from "./LambdaControl";
import { TEXTS } from "./texts";

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});
afterEach(cleanup);

const CURVE = { t: [0, 1], off: [0, 0.05] };
const WITHOUT = { ...CURVE, give: 0.0505, back_s: 11.9, felt_slow: 9.93, felt_fast: 9.59 };
const REJECTED = { ...CURVE, give: 0.0505, back_s: 1.42, felt_slow: 44.9, felt_fast: 7.18 };

function open(
  k_ext: number,
  learned: boolean,
  rejected: Pushed["rejected"] = null,
  std_N = 0.01,
  stale = false,
) {
  const drafted = vi.fn();
  const sent = vi.fn(() => new Promise(() => {}));
  const store = new LiveStore(0);
  const points = learned ? [{ S: 10, F: 0, std_N }] : [];
  store.setState({ touch: { learned: points, contact_N: 0, felt: null } } as unknown as State);
  const forecast = { F: 5, near: Math.PI / 600, k_ext, without: WITHOUT, rejected } as Pushed;
  const preview = { pushed: forecast } as TuningPreview;
  render(
    <MantineProvider>
      <LiveProvider store={store}>
        <DisturbanceFeedforwardControl
          tuning={{ k_ext } as Tuning}
          previewed={{ preview, stale, missing: "computing" }}
          disabled={false}
          onDraft={drafted}
          onCommit={sent}
        />
      </LiveProvider>
    </MantineProvider>,
  );
  return { drafted, sent };
}

const forecastText = () => screen.getByLabelText(TEXTS.pushForecast).textContent;

it("is disabled until the bias of the external force is calibrated", () => {
  open(0, false);
  expect(screen.getByRole<HTMLInputElement>("switch").disabled).toBe(true);
  expect(screen.getByText(/Calibrate at rest first \(Touch\)/)).toBeTruthy();
});

it("is disabled above the service's limit of the standard deviation, but can be switched off", () => {
  open(0, true, null, 0.06);
  const control = () => screen.getByRole<HTMLInputElement>("switch");
  expect(control().disabled).toBe(true);
  expect(
    screen.getByText(/standard deviation of the external-force estimate is 0\.06 N, above 0\.05 N/),
  ).toBeTruthy();
  cleanup();
  open(0.7, true, null, 0.06);
  expect(control().disabled).toBe(false);
});

it("switches on at the default gain with a forecast before the gain is active, and off again", () => {
  const { drafted, sent } = open(0, true);
  fireEvent.click(screen.getByRole("switch"));
  expect(sent.mock.calls).toEqual([[0.7]]);
  expect(drafted).toHaveBeenLastCalledWith(0.7);
  cleanup();
  const on = open(0.7, false); // the calibration may be cleared while the switch is still on
  fireEvent.click(screen.getByRole("switch"));
  expect(on.sent.mock.calls).toEqual([[0]]);
});

it("shows the effect of a push without the rejection", () => {
  open(0, true);
  expect(forecastText()).toMatch(
    /^5 N push: deflection 2\.9°; return to within 0\.3°: 11\.90 s; apparent stiffness 9\.9 N·m\/rad at 0\.1 Hz, 9\.6 at 1 Hz$/,
  );
});

it("shows the effect without and with the rejection, and a joint that does not return", () => {
  open(1, true, REJECTED);
  expect(forecastText()).toContain(
    "return to within 0.3°: 11.90 s → 1.42 s; apparent stiffness 9.9 → 44.9 N·m/rad at 0.1 Hz, 9.6 → 7.2 at 1 Hz",
  );
  cleanup();
  open(1, true, { ...REJECTED, back_s: null });
  expect(forecastText()).toContain(`: 11.90 s → ${TEXTS.never}`);
});

it("is busy while the numbers belong to an earlier value", () => {
  const busy = () => screen.getByLabelText(TEXTS.pushForecast).getAttribute("aria-busy");
  open(0, true);
  expect(busy()).toBe("false");
  cleanup();
  open(0, true, null, 0.01, true);
  expect(busy()).toBe("true");
});
