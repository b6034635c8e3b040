import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, expect, it } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import type { State } from "../../wire/types";
import { TEXTS as SYSTEM } from "../system/texts";
import { CardJumps } from "./OperatePage";
import { TEXTS } from "./texts";

afterEach(cleanup);

it("jumps to each card of the controls, including the trigger", () => {
  const store = new LiveStore(0);
  const state = { link: { starts: 1 }, limits: { F_push_max: 20 }, plant: { simulated: true } };
  store.setState(state as unknown as State);
  const titles = [
    TEXTS.mode,
    TEXTS.references,
    TEXTS.tuning,
    TEXTS.touch,
    TEXTS.push,
    TEXTS.wall,
    SYSTEM.trigger,
  ];
  render(
    <LiveProvider store={store}>
      <div>
        <CardJumps />
        {titles.map((title) => (
          <section key={title} aria-label={title} />
        ))}
      </div>
    </LiveProvider>,
  );
  for (const title of titles) {
    const card = screen.getByRole("region", { name: title });
    card.scrollIntoView = () => undefined;
    fireEvent.click(screen.getByRole("button", { name: fillText(TEXTS.goTo, { card: title }) }));
    expect(document.activeElement).toBe(card);
  }
  expect(screen.getAllByRole("button", { name: /^Go to/ })).toHaveLength(titles.length);
});
