// @vitest-environment jsdom

import { MantineProvider } from "@mantine/core";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { useState } from "react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import { RefusedFields } from "../../service/forms/refusals";
import { type Document, SAMPLE } from "./document";
import { SequenceEditor } from "./SequenceEditor";
import { TEXTS } from "./texts";

describe("SequenceEditor", () => {
  let document: Document = SAMPLE;

  function Composer() {
    const [shown, show] = useState(SAMPLE);
    document = shown;
    return (
      <RefusedFields error={null} foreseen={null}>
        <SequenceEditor document={shown} played={[]} onChange={show} />
      </RefusedFields>
    );
  }

  function opened() {
    render(
      <MantineProvider env="test">
        <LiveProvider store={new LiveStore(0)}>
          <Composer />
        </LiveProvider>
      </MantineProvider>,
    );
  }

  const button = (name: string) => screen.getByRole("button", { name });
  const kinds = () => document.phases[0]?.parts.map((part) => part.do);

  beforeEach(() => {
    vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  });
  afterEach(cleanup);

  it("moves a part by its button, which keeps the focus at the new place", () => {
    opened();
    fireEvent.click(button(fillText(TEXTS.movePartDown, { number: "1.1" })));
    expect(kinds()).toEqual(["ramp", "step", "hold"]);
    expect(globalThis.document.activeElement).toBe(button(fillText(TEXTS.movePartDown, { number: "1.2" })));
    expect(screen.getByRole("status", { name: TEXTS.moved }).textContent).toBe(
      fillText(TEXTS.partMoved, { from: "1.1", to: "1.2" }),
    );
  });

  it("moves a part that is dropped into a loop", () => {
    opened();
    fireEvent.click(button(fillText(TEXTS.repeatPart, { number: "1.2" })));
    const row = screen.getByRole("listitem", { name: fillText(TEXTS.part, { number: "1.3" }) });
    const dataTransfer = { setData() {}, effectAllowed: "" };
    fireEvent.dragStart(row.querySelector("[draggable]") as Element, { dataTransfer });
    fireEvent.drop(button(fillText(TEXTS.addPartAt, { number: "1.2.2" })).closest("li") as Element, {
      dataTransfer,
    });
    expect(document.phases[0]?.parts[1]).toEqual({
      do: "repeat",
      times: 2,
      parts: SAMPLE.phases[0]?.parts.slice(1),
    });
  });

  it("stores a number in SI and an expression as written, and omits empty values", () => {
    opened();
    const box = () =>
      screen.getByRole("textbox", { name: `q_ref [°] ${fillText(TEXTS.ofPart, { number: "1.2" })}` });
    fireEvent.change(box(), { target: { value: "60" } });
    expect(document.phases[0]?.parts[1]?.q_ref).toBeCloseTo(Math.PI / 3, 12);
    fireEvent.change(box(), { target: { value: "2 * pi / 9" } });
    expect(document.phases[0]?.parts[1]?.q_ref).toBe("2 * pi / 9");
    fireEvent.change(box(), { target: { value: "" } });
    expect(document.phases[0]?.parts[1]).toEqual({ do: "ramp", duration_s: 2 });
  });
});
