/**
 * Number box. Enter sends the value; Escape and leaving the box restore the previous one, so that a click elsewhere
 * does not move the joint. A box of a form retains its value when it is left, and a button of the form sends it. Text
 * that is not a number is never sent.
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

/** Time for which the page shows that a value was not sent [ms]. */
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
  /** Whether a button sends the value with others; then leaving the box retains it. */
  readonly isInForm?: boolean;
  /** Id of the element that shows the error. */
  readonly messageId: string;
  /** Whether the service refused the value, if the refusal does not name `place`. */
  readonly refused?: boolean;
  /** Path of the value in the request, as refusals name it. */
  readonly place?: string;
  /** Glossary entry of the input. */
  readonly entry?: Entry | undefined;
  /** Typed number that is not sent yet; undefined without one. */
  onDraft?(value: number | undefined): void;
  /** Receives a number as shown: rounded to the decimals of the box. */
  onCommit(value: number): void;
  /** Reason why the typed value is not sent; null once it is sent, changed or restored. */
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
  const [isInvalid, setInvalid] = useState(false);
  const { ref, said } = useRefusedInput<HTMLInputElement>(place, messageId);
  const isUnsent = !isInForm && typed !== null;
  useDescribedBy(ref, isInvalid || refused || isUnsent ? messageId : undefined);
  const reminder = useRef<number | undefined>(undefined);
  useEffect(() => () => window.clearTimeout(reminder.current), []);
  // A reload or a navigation of the browser removes the focused box without a blur event.
  const commitInForm = useEffectEvent(() => isInForm && commit());
  useEffect(() => {
    window.addEventListener("pagehide", commitInForm);
    return () => {
      window.removeEventListener("pagehide", commitInForm);
      commitInForm();
    };
  }, []);

  function setDraft(text: string | null, problem: string | null = null): void {
    window.clearTimeout(reminder.current);
    setTyped(text);
    setInvalid(problem !== null);
    onProblem(problem ?? (isInForm ? null : unsent(text, TEXTS.unsent)));
    onDraft?.(text === null ? undefined : (numberIn(text) ?? undefined));
  }

  /** Message about a typed number, from its text of the catalogue; null if the text is not a number. */
  function unsent(text: string | null, message: "{value}" | `{value}${string}`): string | null {
    const number = text === null ? null : numberIn(text);
    if (number === null) return null;
    return fillText(message, { value: withUnit(shown(number, decimals), unit) });
  }

  function commit(): void {
    if (typed === null) return;
    const number = numberIn(typed);
    if (typed.trim() === "") setDraft(null);
    else if (number === null) setDraft(typed, fillText(TEXTS.oddNotSent, { problem: notANumber(typed) }));
    else {
      setDraft(null);
      onCommit(rounded(number, decimals));
    }
  }

  /** Restores the previous value, and shows for a while that the typed one was not sent. */
  function restore(): void {
    const message = unsent(typed, TEXTS.wasNotSent);
    if (typed === null) return;
    setDraft(null);
    if (message === null) return;
    onProblem(message);
    reminder.current = window.setTimeout(() => onProblem(null), REMINDER_MS);
  }

  function press(event: KeyboardEvent): void {
    const steps = { ArrowUp: step, ArrowDown: -step }[event.key];
    if (event.key === "Enter") commit();
    else if (event.key === "Escape") setDraft(null);
    else if (steps !== undefined) {
      event.preventDefault();
      closeExplanation(); // Escape discards the stepped value like a typed one
      const from = typed === null ? value : numberIn(typed);
      if (from !== null) setDraft(shown(from + steps, decimals));
    }
  }

  return (
    <TextInput
      {...helped}
      aria-label={label}
      value={typed ?? shown(value, decimals)}
      error={isInvalid || refused || said !== null}
      ref={ref}
      data-unsent={isUnsent || undefined}
      disabled={disabled}
      autoComplete="off"
      w={width}
      rightSection={<span aria-hidden="true">{unit}</span>}
      rightSectionWidth={unit.length * 7 + 12}
      rightSectionPointerEvents="none"
      onChange={(event) => setDraft(event.currentTarget.value)}
      onBlur={(event) => {
        if (isInForm) commit();
        else restore();
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

/** Text of the box; empty for an unknown value. */
function shown(number: number, decimals: number): string {
  return Number.isFinite(number) ? rounded(number, decimals).toFixed(decimals) : "";
}
