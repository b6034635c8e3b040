/** A number that counts once whoever types has come to rest: each change of it is asked of the service. */

import { TextInput } from "@mantine/core";
import { useDebouncedCallback } from "@mantine/hooks";
import { useState } from "react";
import { notANumber } from "../../samples/format";
import { boxText, inSI, labelWith, readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/preferences";

const RESTED_MS = 400;

interface SettledNumberProps {
  readonly label: string;
  /** In SI; null where there is none. */
  readonly value: number | null;
  readonly unit?: string;
  /** What stands before the number in its box. */
  readonly before: string;
  /** What is wrong with a number, "" for nothing. */
  fits(value: number): string;
  /** Whether an empty box is no number on purpose. */
  readonly optional?: boolean;
  onChange(value: number | null): void;
}

export function SettledNumber(props: SettledNumberProps) {
  const { label, before, value, unit = "1", fits, optional, onChange } = props;
  const angles = useAngles();
  const [typed, setTyped] = useState<string | null>(null);
  const settle = useDebouncedCallback((text: string) => {
    const found = inSI(text, unit, angles);
    if (text.trim() === "" && optional) onChange(null);
    else if (found !== null && fits(found) === "") onChange(found);
  }, RESTED_MS);
  const shown = typed ?? (value === null ? "" : boxText(value, unit, angles));
  return (
    <TextInput
      aria-label={labelWith(label, unit, angles)}
      placeholder={label}
      autoComplete="off"
      leftSection={before}
      rightSection={unit === "1" ? null : readingOf(unit, angles).unit}
      rightSectionWidth={70}
      w={170}
      value={shown}
      error={typed === null ? null : wrongWith(typed)}
      onChange={({ currentTarget }) => {
        setTyped(currentTarget.value);
        settle(currentTarget.value);
      }}
      onBlur={() => {
        settle.flush();
        if (wrongWith(shown) === null) setTyped(null);
      }}
    />
  );

  function wrongWith(text: string): string | null {
    if (text.trim() === "" && optional) return null;
    const found = inSI(text, unit, angles);
    if (found === null) return notANumber(text);
    return fits(found) || null;
  }
}
