/** A number of a part, or an expression of the experiment's settings, which counts in SI. What is left out is empty. */

import { TextInput } from "@mantine/core";
import { useState } from "react";
import { boxText, inSI, labelWith } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { useRefusedInput } from "../../service/refusedFields";
import type { Value } from "./document";

interface ExpressionFieldProps {
  readonly words: string;
  readonly unit: string;
  /** Whose it is, for those who do not see where it stands: "of part 1.2". */
  readonly whose: string;
  readonly value: Value | undefined;
  readonly place: string;
  readonly saidAt: string;
  readonly optional?: boolean | undefined;
  onChange(value: number | string | undefined): void;
}

export function ExpressionField(props: ExpressionFieldProps) {
  const { words, unit, whose, value, place, saidAt, optional, onChange } = props;
  const angles = useAngles();
  const [typed, setTyped] = useState<string | null>(null);
  const { ref, said } = useRefusedInput<HTMLInputElement>(place, saidAt);
  const label = labelWith(words, unit, angles);
  const shown = typeof value === "number" ? boxText(value, unit, angles) : String(value ?? "");
  const expression = typeof value === "string" && value.trim() !== "";
  return (
    <TextInput
      label={label}
      aria-label={`${label} ${whose}`}
      ref={ref}
      size="xs"
      autoComplete="off"
      placeholder={optional ? "as it is" : undefined}
      value={typed ?? shown}
      error={said !== null || (value === undefined && !optional)}
      rightSection={
        expression ? <span title={`an expression, counted in ${unit === "1" ? "SI" : unit}`}>ƒ</span> : null
      }
      rightSectionWidth={expression ? 18 : 0}
      onChange={(event) => {
        const text = event.currentTarget.value;
        setTyped(text);
        onChange(text.trim() === "" ? undefined : (inSI(text, unit, angles) ?? text));
      }}
      onBlur={() => setTyped(null)}
    />
  );
}
