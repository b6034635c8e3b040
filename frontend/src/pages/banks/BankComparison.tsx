/** What using this bank in place of another one changes. */

import { NativeSelect } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Card } from "../../components/Card";
import { useLive } from "../../live/react";
import { bankDifferenceQuery, tuningKey } from "../../service/queries";
import type { Bank } from "../../wire/types";
import page from "../Page.module.css";
import { nameOf } from "./BankTable";
import { DifferenceTable } from "./DifferenceTable";

export function BankComparison({ bank, all }: { bank: Bank; all: readonly Bank[] }) {
  const others = all.filter((other) => other.id !== bank.id);
  const likely = others.find((other) => other.active) ?? others.find((other) => other.name === bank.name);
  const [chosen, setChosen] = useState((likely ?? others[0])?.id ?? 0);
  const lambdas = useLive((live) => tuningKey(live.state?.tuning));
  const difference = useQuery(bankDifferenceQuery(chosen, bank.id, lambdas));
  return (
    <Card title={`Changes to ${nameOf(bank)}`}>
      <div className={page.fields}>
        <NativeSelect
          label="From"
          w={260}
          value={String(chosen)}
          data={others.map((other) => ({
            value: String(other.id),
            label: other.active ? `${nameOf(other)}, active` : nameOf(other),
          }))}
          onChange={(event) => setChosen(Number(event.currentTarget.value))}
        />
        {difference.isPending && <p className={page.empty}>Comparing …</p>}
        {difference.error && <p className={page.empty}>{difference.error.message}</p>}
        {difference.data && <DifferenceTable difference={difference.data} />}
      </div>
    </Card>
  );
}
