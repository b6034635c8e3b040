/** A number box that is sent on Enter or when it is left, and given up on Escape. */

import { NumberInput } from "@mantine/core";
import { useState } from "react";

interface ValueBoxProps {
  readonly label: string;
  readonly unit: string;
  readonly value: number;
  readonly decimals: number;
  readonly step: number;
  readonly width: number;
  readonly disabled?: boolean;
  onCommit(value: number): void;
}

export function ValueBox(props: ValueBoxProps) {
  const { label, unit, value, decimals, step, width, disabled = false, onCommit } = props;
  const [typed, setTyped] = useState<string | number | null>(null);

  function commit(): void {
    const number = typeof typed === "string" ? Number(typed.replace("−", "-")) : typed;
    setTyped(null);
    if (number !== null && typed !== "" && Number.isFinite(number)) onCommit(number);
  }

  return (
    <NumberInput
      aria-label={label}
      value={typed ?? Number(value.toFixed(decimals))}
      decimalScale={decimals}
      fixedDecimalScale={typed === null}
      step={step}
      hideControls
      disabled={disabled}
      w={width}
      rightSection={<span aria-hidden="true">{unit}</span>}
      rightSectionWidth={unit.length * 7 + 12}
      rightSectionPointerEvents="none"
      onChange={setTyped}
      onBlur={commit}
      onKeyDown={(event) => {
        if (event.key === "Enter") commit();
        if (event.key === "Escape") setTyped(null);
      }}
      styles={{
        input: { textAlign: "right", fontWeight: 500 },
        section: { color: "var(--text-2)", fontSize: 11 },
      }}
    />
  );
}
