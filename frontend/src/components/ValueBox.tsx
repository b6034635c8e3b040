/**
 * A number box. Enter sends the value; Escape and leaving the box restore the one before, so that no click elsewhere
 * moves the joint. A box of a form keeps its value when it is left, and a button of the form sends it. A text that is
 * no number is never sent.
 */

import { TextInput } from "@mantine/core";
import { type KeyboardEvent, useEffect, useEffectEvent, useRef, useState } from "react";
import { notANumber, numberIn } from "../samples/format";
import { withUnit } from "../samples/quantity";
import { fillText } from "../samples/texts";
import { useDescribedBy, useRefusedInput } from "../service/forms/refusals";
import { closeExplanation, type Entry } from "../service/glossary";
import { help } from "./Shortcuts";
import { TEXTS } from "./texts";

/** So long the page says that a value that was left was not sent [ms]. */
const REMINDER_MS = 8000;
const UNSENT = { borderStyle: "dashed", borderColor: "var(--warn-text)", borderWidth: 2 } as const;

interface ValueBoxProps {
  readonly label: string;
  readonly unit: string;
  readonly value: number;
  readonly decimals: number;
  readonly step: number;
  readonly width: number;
  readonly disabled?: boolean;
  /** Whether a button sends the value together with others: leaving the box keeps it. */
  readonly isInForm?: boolean;
  /** The element that says why the value is not taken. */
  readonly messageId: string;
  /** Whether the service refused the value, where that is known otherwise than by `place`. */
  readonly refused?: boolean;
  /** Where the value stands in what is sent, as refusals name it. */
  readonly place?: string;
  /** What it is for. */
  readonly entry?: Entry | undefined;
  /** The number that is typed and not sent; undefined where there is none. */
  onDraft?(value: number | undefined): void;
  /** A number as it is shown: rounded to the decimals of the box. */
  onCommit(value: number): void;
  /** Why the typed value is not sent; null once it is sent, changed or restored. */
  onProblem(problem: string | null): void;
}

export function ValueBox(props: ValueBoxProps) {
  const {
    label,
    unit,
    value,
    decimals,
    step,
    width,
    disabled = false,
    isInForm = false,
    messageId,
    refused = false,
    place,
    entry,
    onDraft,
    onCommit,
    onProblem,
  } = props;
  const { onBlur, ...helped } = help(entry);
  const [typed, setTyped] = useState<string | null>(null);
  const [odd, setOdd] = useState(false);
  const { ref, said } = useRefusedInput<HTMLInputElement>(place, messageId);
  const isUnsent = !isInForm && typed !== null;
  useDescribedBy(ref, odd || refused || isUnsent ? messageId : undefined);
  const reminder = useRef<number | undefined>(undefined);
  useEffect(() => () => window.clearTimeout(reminder.current), []);
  // a reload, and the way back of the browser, take the box away with the focus in it: no blur is heard then
  const keep = useEffectEvent(() => isInForm && commit());
  useEffect(() => {
    window.addEventListener("pagehide", keep);
    return () => {
      window.removeEventListener("pagehide", keep);
      keep();
    };
  }, []);

  function take(text: string | null, problem: string | null = null): void {
    window.clearTimeout(reminder.current);
    setTyped(text);
    setOdd(problem !== null);
    onProblem(problem ?? (isInForm ? null : unsent(text, TEXTS.unsent)));
    onDraft?.(text === null ? undefined : (numberIn(text) ?? undefined));
  }

  /** The message about a typed number, by its entry of the catalogue; null where the text is none. */
  function unsent(text: string | null, message: "{value}" | `{value}${string}`): string | null {
    const number = text === null ? null : numberIn(text);
    if (number === null) return null;
    return fillText(message, { value: withUnit(shown(number, decimals), unit) });
  }

  function commit(): void {
    if (typed === null) return;
    const number = numberIn(typed);
    if (typed.trim() === "") take(null);
    else if (number === null) take(typed, fillText(TEXTS.oddNotSent, { problem: notANumber(typed) }));
    else {
      take(null);
      onCommit(rounded(number, decimals));
    }
  }

  /** Restore the value before, and say for a while that the typed one was not sent. */
  function leave(): void {
    const was = unsent(typed, TEXTS.wasNotSent);
    if (typed === null) return;
    take(null);
    if (was === null) return;
    onProblem(was);
    reminder.current = window.setTimeout(() => onProblem(null), REMINDER_MS);
  }

  function press(event: KeyboardEvent): void {
    const steps = { ArrowUp: step, ArrowDown: -step }[event.key];
    if (event.key === "Enter") commit();
    else if (event.key === "Escape") take(null);
    else if (steps !== undefined) {
      event.preventDefault();
      closeExplanation(); // Escape gives up what was stepped to, as what was typed
      const from = typed === null ? value : numberIn(typed);
      if (from !== null) take(shown(from + steps, decimals));
    }
  }

  return (
    <TextInput
      {...helped}
      aria-label={label}
      value={typed ?? shown(value, decimals)}
      error={odd || refused || said !== null}
      ref={ref}
      data-unsent={isUnsent || undefined}
      disabled={disabled}
      autoComplete="off"
      w={width}
      rightSection={<span aria-hidden="true">{unit}</span>}
      rightSectionWidth={unit.length * 7 + 12}
      rightSectionPointerEvents="none"
      onChange={(event) => take(event.currentTarget.value)}
      onBlur={(event) => {
        if (isInForm) commit();
        else leave();
        onBlur?.(event);
      }}
      onKeyDown={press}
      styles={{
        input: { textAlign: "right", fontWeight: 500, ...(isUnsent ? UNSENT : {}) },
        section: { color: "var(--text-2)", fontSize: 11 },
      }}
    />
  );
}

function rounded(number: number, decimals: number): number {
  return Number(number.toFixed(decimals)) + 0; // + 0: no negative zero
}

/** What the box shows; nothing of a value that is not known. */
function shown(number: number, decimals: number): string {
  return Number.isFinite(number) ? rounded(number, decimals).toFixed(decimals) : "";
}
