// @vitest-environment jsdom
import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, expect, it, vi } from "vitest";
import type { ViewControl } from "../../charts/viewport";
import type { DryRun } from "../../wire/types";

vi.mock("../../charts/Charts", () => ({
  Charts: ({ control }: { control: ViewControl }) => (
    <button
      type="button"
      onClick={() => control.change({ span_s: 1, end_s: 2 })}
    >{`${control.view.span_s} s to ${control.view.end_s} s`}</button>
  ),
}));
vi.mock("../../theme/useLayouts", () => ({ useStandardPanels: () => [] }));
vi.mock("../../wire/curves", () => ({ excerptOf: () => ({ from_s: 0, t: [], columns: {} }) }));
vi.mock("../../charts/sources", () => ({
  RecordedSource: class {
    setOverview() {}
  },
}));

import { DryRunCurves } from "./DryRun";

afterEach(cleanup);

it("shows the whole of each preview, also if the previous one was shorter or zoomed", () => {
  const samples = {} as NonNullable<DryRun["samples"]>;
  const { rerender } = render(<DryRunCurves samples={samples} duration_s={6} name="preview" />);
  const shown = () => screen.getByRole("button", { name: / s to / }).textContent;
  expect(shown()).toBe("6 s to 6 s");
  rerender(<DryRunCurves samples={samples} duration_s={10} name="preview" />);
  expect(shown()).toBe("10 s to 10 s");
  screen.getByRole("button", { name: / s to / }).click();
  rerender(<DryRunCurves samples={{ ...samples }} duration_s={10} name="preview" />);
  expect(shown()).toBe("1 s to 2 s"); // a zoom persists while the duration does not change
  rerender(<DryRunCurves samples={samples} duration_s={4} name="preview" />);
  expect(shown()).toBe("4 s to 4 s");
});
