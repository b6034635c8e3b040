/** A number box that is sent on Enter or when it is left, and given up on Escape. What is no number is never sent. */

import { TextInput } from "@mantine/core";
import { type KeyboardEvent, useState } from "react";
import { notANumber, numberIn } from "../samples/number";
import { close } from "../service/explaining";
import type { Entry } from "../service/glossary";
import { useRefusedInput } from "../service/refusedFields";
import { useDescribedBy } from "../service/useDescribedBy";
import { help } from "./help";

interface ValueBoxProps {
  readonly label: string;
  readonly unit: string;
  readonly value: number;
  readonly decimals: number;
  readonly step: number;
  readonly width: number;
  readonly disabled?: boolean;
  /** The element that says why the value is not taken. */
  readonly saidAt: string;
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
  /** Why what was typed is not sent; null once it is changed or given up. */
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
    saidAt,
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
  const { ref, said } = useRefusedInput<HTMLInputElement>(place, saidAt);
  useDescribedBy(ref, odd || refused ? saidAt : undefined);

  function take(text: string | null, problem: string | null = null): void {
    setTyped(text);
    setOdd(problem !== null);
    onProblem(problem);
    onDraft?.(text === null ? undefined : (numberIn(text) ?? undefined));
  }

  function commit(): void {
    if (typed === null) return;
    const number = numberIn(typed);
    if (typed.trim() === "") take(null);
    else if (number === null) take(typed, `${notANumber(typed)}: nothing was sent. Escape restores.`);
    else {
      take(null);
      onCommit(rounded(number, decimals));
    }
  }

  function press(event: KeyboardEvent): void {
    const steps = { ArrowUp: step, ArrowDown: -step }[event.key];
    if (event.key === "Enter") commit();
    else if (event.key === "Escape") take(null);
    else if (steps !== undefined) {
      event.preventDefault();
      close(); // Escape gives up what was stepped to, as what was typed
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
      disabled={disabled}
      autoComplete="off"
      w={width}
      rightSection={<span aria-hidden="true">{unit}</span>}
      rightSectionWidth={unit.length * 7 + 12}
      rightSectionPointerEvents="none"
      onChange={(event) => take(event.currentTarget.value)}
      onBlur={(event) => {
        commit();
        onBlur?.(event);
      }}
      onKeyDown={press}
      styles={{
        input: { textAlign: "right", fontWeight: 500 },
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
