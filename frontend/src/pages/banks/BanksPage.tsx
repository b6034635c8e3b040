/** Banks of controllers: versions, entries with gains and robustness, where each came from, and what a change does. */

import { useQuery } from "@tanstack/react-query";
import { useParams } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { banksQuery } from "../../service/queries";
import page from "../Page.module.css";
import { BankComparison } from "./BankComparison";
import { BankEntries } from "./BankEntries";
import { BankImport } from "./BankImport";
import { BankTable } from "./BankTable";
import { DefaultGainsCard } from "./DefaultGainsCard";
import { InForce } from "./InForce";

export default function BanksPage() {
  const { id } = useParams();
  const banks = useQuery(banksQuery);
  const all = banks.data ?? [];
  const selected = all.find((bank) => bank.id === Number(id)) ?? all.find((bank) => bank.active) ?? all[0];
  return (
    <div className={page.page}>
      <h1 className={page.title}>Banks</h1>
      <Card
        title="Versions"
        aside={
          <OperatorsOnly>
            <BankImport />
          </OperatorsOnly>
        }
      >
        <InForce banks={all} />
        {banks.data === undefined ? (
          <p className={page.empty}>{banks.error?.message ?? "Loading …"}</p>
        ) : (
          <BankTable banks={all} selected={selected?.id} />
        )}
      </Card>
      {banks.data?.length === 0 && <DefaultGainsCard />}
      {selected && <BankEntries bank={selected} />}
      {selected && all.length > 1 && <BankComparison key={selected.id} bank={selected} all={all} />}
    </div>
  );
}
