/** Choice of further runs for the same axes. */

import { ActionIcon, NativeSelect } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { TbX } from "react-icons/tb";
import { useLocation } from "wouter";
import { dateTime } from "../../samples/format";
import { runsQuery } from "../../service/queries";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";
import { addressOf, MOST_COMPARED } from "./address";

const OFFERED = 100;

interface CompareWithProps {
  readonly run: Run;
  readonly others: readonly number[];
  /** How they are compared, as the address has it. */
  readonly how?: string;
}

export function CompareWith({ run, others, how = "" }: CompareWithProps) {
  const [, go] = useLocation();
  const runs = useQuery(runsQuery({ limit: OFFERED, offset: 0 }));
  const offered = (runs.data?.runs ?? []).filter(
    ({ id, samples }) => id !== run.id && samples > 0 && !others.includes(id),
  );
  // those of the same kind come first: they are what one compares with
  const sorted = [...offered].sort((a, b) => Number(b.title === run.title) - Number(a.title === run.title));
  return (
    <div className={page.actions}>
      {others.map((id) => (
        <span key={id}>
          run {id}
          <ActionIcon
            size={18}
            variant="subtle"
            color="gray"
            aria-label={`Leave out run ${id}`}
            onClick={() =>
              go(
                addressOf(
                  run.id,
                  others.filter((other) => other !== id),
                  null,
                  how,
                ),
              )
            }
          >
            <TbX size={12} />
          </ActionIcon>
        </span>
      ))}
      <NativeSelect
        aria-label="Compare with"
        value=""
        disabled={others.length >= MOST_COMPARED - 1}
        onChange={(event) => go(addressOf(run.id, [...others, Number(event.currentTarget.value)], null, how))}
        data={[
          { value: "", label: others.length === 0 ? "Compare with …" : "and with …" },
          ...sorted.map(({ id, title, started }) => ({
            value: String(id),
            label: `run ${id}, ${title}, ${dateTime(started)}`,
          })),
        ]}
      />
    </div>
  );
}
